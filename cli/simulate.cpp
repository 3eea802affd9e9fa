// simulate: the far end of every wire a rig names.
#include <fcntl.h>
#include <fmt/format.h>
#include <poll.h>
#include <unistd.h>

#include <array>
#include <atomic>
#include <csignal>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <optional>

#include "cli/json_fields.h"
#include "cli/rig_files.h"
#include "cli/say.h"
#include "cli/verbs.h"
#include "config/json_text.h"
#include "core/brdf_table.h"
#include "daemon/session/durable_file.h"
#include "sim/hosted_rig.h"
#include "sim/open_devices.h"
#include "sim/world.h"

namespace lightrig::cli {
namespace {

namespace fs = std::filesystem;

constexpr int beat_ms = 100;    ///< between looks at what has struck
constexpr int truth_phi = 180;  ///< φd values the truth is averaged over: MERL's own number

void tell(const std::string& line) {
  say(line);
  std::fflush(stdout);  // whoever waits for "ready" reads a pipe
}

std::atomic<bool>& end_was_asked() {
  static std::atomic<bool> asked{false};
  return asked;
}

// By handler, not by mask: libraries have threads of their own that were there before us, and a
// signal may be delivered to any of them.
void heed_signals() {
  struct sigaction action {};
  action.sa_handler = [](int) { end_was_asked() = true; };
  end_was_asked() = false;
  for (const int one : {SIGTERM, SIGINT, SIGHUP}) sigaction(one, &action, nullptr);
  std::signal(SIGPIPE, SIG_IGN);
}

Result<fs::path> write_truth(const Rig& rig, const std::string& wanted) {
  const auto truth = sim::truth_of(rig);
  if (!truth) return tl::unexpected(with_context("the simulator's truth", truth.error()));
  const fs::path path =
      wanted.empty() ? rig.session_root / ".simulated-truth.binary" : fs::absolute(wanted);
  const BrdfTable table = tabulate(*truth, BivariateGrid{}, truth_phi);
  if (auto made = make_folder(path.parent_path()); !made) return tl::unexpected(made.error());
  if (auto written = write_durably(path, encode_merl(to_merl(table, 1))); !written)
    return tl::unexpected(with_context("write the simulator's truth", written.error()));
  return path;
}

Result<void> add_faults(sim::HostedRig& hosted, const std::string& file) {
  if (file.empty()) return {};
  std::ifstream in(file);
  if (!in)
    return fail(ErrorCode::not_found,
                fmt::format("read the script of faults {}: no such file", file));
  return hosted.add_faults({std::istreambuf_iterator<char>(in), {}}, file);
}

void describe(const sim::HostedRig& hosted, const fs::path& truth, const Rig& rig, bool json) {
  if (json) {
    Json wires = Json::array();
    for (const sim::HostedWire& wire : hosted.wires)
      wires.push_back({{"part", wire.part}, {"address", wire.address}});
    return tell(json_text(Json{{"rig", rig.name},
                               {"wires", std::move(wires)},
                               {"environment", hosted.environment()},
                               {"truth", truth.string()}}));
  }
  say("rig          " + rig.name);
  for (const sim::HostedWire& wire : hosted.wires)
    say(fmt::format("{:<12} {}", wire.part, wire.address));
  say("truth        " + truth.string());
  for (const auto& [name, value] : hosted.environment())
    say(fmt::format("environment  export {}={}", name, value));
  tell(
      "ready        faults are read from standard input, one a line (docs/simulate.md); Ctrl-C "
      "ends");
}

/// Faults typed while it runs.
class TypedFaults {
 public:
  explicit TypedFaults(sim::HostedRig& hosted) : hosted_(hosted) {}

  /// Takes what has come; false once nothing more will.
  bool read_some() {
    std::array<char, 4096> buffer{};
    const ssize_t got = read(STDIN_FILENO, buffer.data(), buffer.size());
    if (got <= 0) return false;
    text_.append(buffer.data(), static_cast<std::size_t>(got));
    for (std::size_t end = text_.find('\n'); end != std::string::npos; end = text_.find('\n')) {
      take(text_.substr(0, end));
      text_.erase(0, end + 1);
    }
    return true;
  }

 private:
  void take(const std::string& line) {
    if (line.find_first_not_of(" \t\r") == std::string::npos) return;
    if (auto added = hosted_.add_fault(line); !added) complain(added.error());
  }

  sim::HostedRig& hosted_;
  std::string text_;
};

// Until a signal ends it; says what strikes as it strikes.
void run(sim::HostedRig& hosted, bool tell_halts) {
  TypedFaults typed(hosted);
  bool listening = true;
  std::size_t told = 0, halts_told = 0;
  while (!end_was_asked()) {
    pollfd watch{listening ? STDIN_FILENO : -1, POLLIN, 0};
    poll(&watch, 1, beat_ms);
    const std::vector<std::string> struck = hosted.struck();
    for (; told < struck.size(); ++told) tell("fault        " + struck[told]);
    const std::vector<TimePoint> halts = hosted.world->halts();
    for (; tell_halts && halts_told < halts.size(); ++halts_told) {
      const std::chrono::duration<double> at = halts[halts_told].time_since_epoch();
      tell(fmt::format("halted       {:.6f}", at.count()));
    }
    if (watch.revents != 0) listening = typed.read_some();
  }
}

Result<void> write_record(const sim::World& world, const std::string& path) {
  if (path.empty()) return {};
  std::string text;
  for (const sim::ExposureRecord& record : world.records()) {
    const AxisValues& axes = record.moment.drives.axes;
    const Json line{{"frame", record.frame_id},
                    {"exposure_s", record.exposure},
                    {"axes_si", std::vector<double>(axes.data(), axes.data() + axes.size())},
                    {"moving", record.moment.moving},
                    {"lamp_power", record.moment.lamp_power},
                    {"content", fmt::format("{:016x}", record.content)}};
    text += json_text(line) + "\n";
  }
  return write_durably(path, std::as_bytes(std::span(text)));
}

}  // namespace

int simulate(const SimulateOptions& options) {
  heed_signals();
  const RigFiles files = read_rig_files(options.rig, options.session);
  show_diagnostics(files);
  if (!files.valid()) return 1;
  const Rig& rig = *files.rig.value;
  const std::uint64_t seed = options.seed.value_or(rig.simulation ? rig.simulation->seed : 1);
  auto hosted = sim::host_rig(rig, files.spec().object, seed);
  if (!hosted) return complain(hosted.error());
  if (auto added = add_faults(*hosted, options.faults); !added) return complain(added.error());
  const auto truth = write_truth(rig, options.truth);
  if (!truth) return complain(truth.error());
  describe(*hosted, *truth, rig, options.json);
  run(*hosted, options.tell_halts);
  hosted->wires.clear();
  if (auto written = write_record(*hosted->world, options.record); !written)
    return complain(written.error());
  tell("ended");
  return 0;
}

}  // namespace lightrig::cli
