// Seeded single faults over every wire and phase of a session. Each trial hosts a small rig at the
// far end of its wires, opens the real drivers on it, lets one fault strike somewhere and captures
// a session with it; then the session folder is held against the laboratory's own record: every
// frame that the journal vouches for must have been taken where, how long and under which light it
// says.
//   fault_campaign [--count N] [--seed N] [--jobs N] [--wire NAME] [--only N] [--verbose]
#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <map>
#include <memory>
#include <mutex>
#include <random>
#include <thread>
#include <vector>

#include "config/read_rig.h"
#include "core/check.h"
#include "daemon/session/frame_file.h"
#include "daemon/session/session.h"
#include "drivers/backends.h"
#include "sim/hosted_rig.h"
#include "sim/memory_devices.h"
#include "sim/world.h"
#include "tests/drivers/own_network.h"
#include "tests/wire/small_wire_rig.h"

namespace lightrig {
namespace {

namespace fs = std::filesystem;
using namespace std::chrono_literals;
using std::chrono::steady_clock;

constexpr auto stated_time = 90s;             ///< by which every trial must have ended by itself
constexpr auto patience_with_pause = 1500ms;  ///< then the person of this story gives up

/// A wire kind of the campaign, with the faults that it can have.
struct WireKind {
  std::string name, rig_file;
  std::vector<std::string> effects;
};

const std::vector<std::string> drive_effects{"alarm", "limit",  "jam",   "slip",
                                             "door",  "e_stop", "reboot"};

std::vector<std::string> with_drive_effects(std::vector<std::string> effects) {
  effects.insert(effects.end(), drive_effects.begin(), drive_effects.end());
  return effects;
}

/// A USB device is seen only by a program that runs under umockdev, and one at a time.
bool sees_usb() {
  const char* loaded = std::getenv("LD_PRELOAD");
  return loaded != nullptr && std::string(loaded).find("umockdev") != std::string::npos;
}

std::vector<WireKind> wire_kinds() {
  const std::vector<std::string> answers{"silence",   "lost_answer", "exception", "late",
                                         "duplicate", "truncated",   "corrupted", "short_reads"};
  auto tcp = answers, rtu = answers, grbl = answers;
  for (const char* effect :
       {"wrong_id", "closed", "half_open", "unplug", "watchdog", "lamp_failure"})
    tcp.emplace_back(effect);
  for (const char* effect : {"wrong_id", "unplug", "watchdog", "lamp_failure"})
    rtu.emplace_back(effect);
  grbl.emplace_back("unplug");
  if (sees_usb()) {
    grbl.emplace_back("stall");
    grbl.emplace_back("nak");
    return {{"usb", "wire_usb.toml", with_drive_effects(grbl)}};
  }
  return {{"tcp", "wire_modbus_tcp.toml", with_drive_effects(tcp)},
          {"rtu", "wire_modbus_rtu.toml", with_drive_effects(rtu)},
          {"grbl", "wire_grbl.toml", with_drive_effects(grbl)},
          {"camera",
           "wire_modbus_tcp.toml",
           {"packet_lost", "packet_gone", "leader_gone", "trailer_lost", "packets_reordered",
            "packets_doubled", "frozen", "rebooted", "privilege_stolen", "wrong_exposure",
            "stale_frame", "wrong_size"}}};
}

/// Everything a trial needs that is the same for all of its kind.
struct Bench {
  Rig rig;
  SessionSpec spec;
  Prepared prepared;
  std::uint64_t requests = 0, frames = 0;  ///< of a session in which nothing goes wrong
  double seconds = 0;
};

struct Trial {
  std::string wire, fault;
  std::uint64_t seed = 1;
};

enum class Verdict { completed, paused, aborted };

struct Outcome {
  Verdict verdict = Verdict::aborted;
  std::string reason;
  std::vector<std::string> wrong;  ///< frames that are not what they say
  bool struck = false, lamp_on_unsaid = false, late = false;
  double seconds = 0;
  std::uint64_t requests = 0, frames = 0;
};

[[noreturn]] void die(const std::string& why) {
  std::fprintf(stderr, "fault_campaign: %s\n", why.c_str());
  std::exit(2);
}

Rig read_small_rig(const WireKind& kind, const fs::path& folder, int worker) {
  test::SmallWireRig text(kind.rig_file);
  text.sessions_in(folder / "sessions");
  if (kind.name == "camera") {
    text.set("id", fmt::format("\"127.0.0.{}\"", 10 + worker));
  } else {
    text.replace("backend = \"aravis\"", "backend = \"simulated\"");
    text.replace("[camera.aravis]\nid = \"127.0.0.1\"\nsocket_buffer_bytes = ", "# ");
  }
  const bool modbus = kind.name != "grbl" && kind.name != "usb";
  if (modbus) text.set("timeout_ms", "300");
  if (kind.name == "tcp" || kind.name == "camera")
    text.set("port", std::to_string((kind.name == "tcp" ? 15020 : 16020) + worker));
  else if (kind.name != "usb")
    text.set("device", fmt::format("\"{}/device-{}\"", folder.string(), worker));
  const fs::path file = folder / fmt::format("{}-{}.toml", kind.name, worker);
  std::ofstream(file) << text.text();
  auto read = read_rig(file);
  for (const Diagnostic& one : read.diagnostics)
    std::fprintf(stderr, "%s\n", to_text(one, read.text).c_str());
  if (!read.value) die("the small rig is not valid");
  return std::move(*read.value);
}

Result<Devices> open_over_wires(const Rig& rig, Clock& clock, std::shared_ptr<sim::World> world) {
  Devices devices;
  Result<GantryAndLamp> opened = [&] {
    if (const auto* modbus = std::get_if<ModbusGantry>(&rig.gantry.backend))
      return open_gantry(rig, *modbus, clock);
    return open_gantry(rig, std::get<GrblGantry>(rig.gantry.backend), clock);
  }();
  if (!opened) return tl::unexpected(with_context("open gantry", opened.error()));
  devices.gantry = std::move(opened->gantry);
  devices.lamp = std::move(opened->lamp);
  if (auto dark = devices.lamp->set(0, {clock.now() + 2s, {}}); !dark)
    return tl::unexpected(with_context("make the lamp dark", dark.error()));
  if (const auto* aravis = std::get_if<AravisCamera>(&rig.camera.backend)) {
    auto camera = open_camera(rig, *aravis, clock);
    if (!camera) return tl::unexpected(with_context("open camera", camera.error()));
    devices.camera = std::move(*camera);
  } else {
    devices.camera = sim::make_camera(std::move(world));
  }
  return devices;
}

/// What the laboratory recorded of each picture, by its content.
class Judge {
 public:
  Judge(const Bench& bench, const sim::World& world) : bench_(bench) {
    for (const sim::ExposureRecord& record : world.records()) by_content_[record.content] = record;
  }

  std::vector<std::string> wrong_frames(const fs::path& root) const {
    std::vector<std::string> wrong;
    const auto record = read_session_folder(root);
    if (!record) return {"the session folder cannot be read: " + record.error().message};
    for (const StoredFrame& frame : record->darks) check(root, frame, nullptr, wrong);
    for (const CapturedShot& shot : record->shots) {
      const Shot& planned = bench_.prepared.plan.shots[static_cast<std::size_t>(shot.index)];
      for (const StoredFrame& frame : shot.frames) check(root, frame, &planned, wrong);
    }
    return wrong;
  }

 private:
  void check(const fs::path& root, const StoredFrame& stored, const Shot* planned,
             std::vector<std::string>& wrong) const {
    const auto frame = read_frame(root / stored.file);
    if (!frame) return wrong.push_back(stored.file + " cannot be read");
    const auto found = by_content_.find(sim::content_of(frame->counts));
    if (found == by_content_.end())
      return wrong.push_back(stored.file + " is no picture that was taken");
    const sim::ExposureRecord& truth = found->second;
    const double power =
        stored.role == "dark" || stored.role == "ambient" ? 0.0 : bench_.rig.lamp.power;
    if (std::abs(truth.exposure - stored.exposure) > std::max(0.01 * stored.exposure, 1e-5))
      wrong.push_back(fmt::format("{}: exposed for {} s, not {} s", stored.file, truth.exposure,
                                  stored.exposure));
    if (std::abs(truth.moment.lamp_power - power) > 0.01)
      wrong.push_back(
          fmt::format("{}: lamp at {}, not {}", stored.file, truth.moment.lamp_power, power));
    if (!planned) return;  // a dark frame may be taken anywhere
    const double off = (truth.moment.drives.axes - planned->gantry.axes).cwiseAbs().maxCoeff();
    if (truth.moment.moving || !(off <= 1.05 * bench_.rig.gantry.model.tolerance))
      wrong.push_back(fmt::format("{}: taken {:.4f} rad off{}", stored.file, off,
                                  truth.moment.moving ? ", in motion" : ""));
  }

  const Bench& bench_;
  std::map<std::uint64_t, sim::ExposureRecord> by_content_;
};

/// The person of the story: resumes what paused once its cause is gone, and gives up when it is
/// not.
class Person {
 public:
  Person(SessionControl& control, const sim::World& world) : control_(control), world_(world) {}

  void see(const SessionProgress& progress) {
    if (!progress.activity.starts_with("paused")) {
      since_.reset();
      return;
    }
    if (world_.gantry_status().open_interlocks.empty()) return control_.resume();
    if (!since_) since_ = steady_clock::now();
    if (steady_clock::now() - *since_ > patience_with_pause) control_.halt(progress.activity);
  }

 private:
  SessionControl& control_;
  const sim::World& world_;
  std::optional<steady_clock::time_point> since_;
};

Verdict verdict_of(SessionOutcome outcome) {
  if (outcome == SessionOutcome::done || outcome == SessionOutcome::stopped_early)
    return Verdict::completed;
  return outcome == SessionOutcome::paused ? Verdict::paused : Verdict::aborted;
}

Outcome run_trial(const Bench& bench, const Trial& trial, const std::string& id) {
  Outcome outcome;
  const auto began = steady_clock::now();
  auto hosted = sim::host_rig(bench.rig, bench.spec.object, trial.seed);
  if (!hosted) die(hosted.error().message);
  if (!trial.fault.empty()) {
    if (auto added = hosted->add_fault(trial.fault); !added) die(added.error().message);
  }
  RealClock clock;
  const auto open = [&] { return open_over_wires(bench.rig, clock, hosted->world); };
  const auto folder = create_session(bench.rig, bench.spec, bench.prepared, id);
  if (!folder) die(folder.error().message);
  SessionEnd end{SessionOutcome::aborted, "", false};
  {
    auto devices = open();
    if (!devices) {
      end.reason = devices.error().message;
    } else {
      SessionControl control;
      Person person(control, *hosted->world);
      SessionListeners listeners;
      listeners.progress = [&](const SessionProgress& progress) { person.see(progress); };
      std::jthread alarm_clock([&](const std::stop_token& over) {
        clock.sleep_until(clock.now() + stated_time, over);
        if (!over.stop_requested()) control.abort("the campaign's own limit");
      });
      end = capture(*folder, bench.rig, bench.spec, bench.prepared, *devices, clock, control,
                    listeners, open);
      outcome.late = control.reason() == "the campaign's own limit";
    }
    outcome.lamp_on_unsaid =
        outcome.lamp_on_unsaid || (hosted->world->lamp_power() > 0 && !end.lamp_may_be_on);
  }
  outcome.verdict = verdict_of(end.outcome);
  outcome.reason = end.reason;
  outcome.struck = !hosted->struck().empty();
  outcome.frames = hosted->world->records().size();
  outcome.requests = hosted->faults->requests(sim::Wire::gantry);
  outcome.wrong = Judge(bench, *hosted->world).wrong_frames(folder->root);
  outcome.seconds = std::chrono::duration<double>(steady_clock::now() - began).count();
  fs::remove_all(folder->root);
  return outcome;
}

/// The n-th fault of a seed: wire, effect, and the moment in the session, all drawn.
Trial draw(std::uint64_t seed, const std::vector<WireKind>& kinds,
           const std::map<std::string, Bench>& benches) {
  std::mt19937_64 chance(seed);
  const auto below = [&](std::size_t n) {
    return std::uniform_int_distribution<std::size_t>(0, n - 1)(chance);
  };
  const WireKind& kind = kinds[below(kinds.size())];
  const Bench& bench = benches.at(kind.name);
  const std::string& effect = kind.effects[below(kind.effects.size())];
  if (kind.name == "camera")
    return {kind.name,
            fmt::format("{} frame={} seconds={:.1f}", effect, 1 + below(bench.frames),
                        0.5 + 0.1 * static_cast<double>(below(60))),
            seed};
  const std::size_t shots = bench.prepared.plan.shots.size();
  std::string moment;
  switch (below(5)) {
    case 0:
    case 1:
      moment = fmt::format("request={}", 1 + below(bench.requests));
      break;
    case 2:
      moment = fmt::format("motion={} delay_ms={}", 1 + below(shots + 1), below(300));
      break;
    case 3:
      moment = fmt::format("lit={} delay_ms={}", 1 + below(shots), below(200));
      break;
    default:
      moment = fmt::format("time={:.3f}", bench.seconds * static_cast<double>(below(1000)) / 1000);
  }
  std::string rest;
  if (effect == "slip")
    rest = fmt::format(" degrees={}", 0.05 * static_cast<double>(1 + below(100)));
  if (effect == "late") rest = fmt::format(" ms={}", 150 + below(400));
  if (effect == "alarm")
    rest = fmt::format(" code={}", kind.name == "grbl" || kind.name == "usb" ? 1 + below(3) : 16);
  if (effect == "door" || effect == "e_stop") rest = below(2) == 0 ? " ms=0" : " ms=400";
  if (effect == "silence" || effect == "lost_answer") rest = fmt::format(" count={}", 1 + below(4));
  if (effect == "unplug" || effect == "reboot") rest = fmt::format(" ms={}", 200 + below(1500));
  return {kind.name, effect + " " + moment + rest, seed};
}

struct Options {
  int count = 300, jobs = 8;
  std::uint64_t seed = 1;
  std::string wire;
  bool verbose = false;
};

Options read_options(int argc, char** argv) {
  Options options;
  for (int i = 1; i < argc; ++i) {
    const std::string word = argv[i];
    const auto value = [&] {
      if (++i >= argc) die(word + " needs a value");
      return std::string(argv[i]);
    };
    if (word == "--count")
      options.count = std::stoi(value());
    else if (word == "--jobs")
      options.jobs = std::stoi(value());
    else if (word == "--seed")
      options.seed = std::stoull(value());
    else if (word == "--wire")
      options.wire = value();
    else if (word == "--verbose")
      options.verbose = true;
    else
      die("unknown option " + word + "; there are --count --jobs --seed --wire --verbose");
  }
  return options;
}

/// What a campaign of its own found on the USB wire.
struct UsbShare {
  int faults = 0, completed = 0, paused = 0, aborted = 0, missed = 0, wrong_frames = 0,
      lamp_on_unsaid = 0, late = 0;
  std::string table;
};

/// This program once more, under umockdev.
class UsbChild {
 public:
  UsbChild(int count, std::uint64_t seed, bool verbose) {
    if (count < 1) return;
    const std::string self = fs::read_symlink("/proc/self/exe").string();
    pipe_ =
        popen(fmt::format("LD_PRELOAD=libumockdev-preload.so.0 {} --jobs 1 --count {} --seed {}{}",
                          self, count, seed, verbose ? " --verbose" : "")
                  .c_str(),
              "r");
  }
  ~UsbChild() {
    if (pipe_) pclose(pipe_);
  }
  UsbChild(const UsbChild&) = delete;
  UsbChild& operator=(const UsbChild&) = delete;

  UsbShare wait() {
    UsbShare share;
    if (!pipe_) return share;
    std::string text;
    std::array<char, 4096> buffer{};
    for (std::size_t n = 0; (n = std::fread(buffer.data(), 1, buffer.size(), pipe_)) > 0;)
      text.append(buffer.data(), n);
    const std::size_t last = text.rfind("faults=");
    if (last == std::string::npos) die("the USB wire's share came to no end: " + text);
    std::sscanf(text.c_str() + last,
                "faults=%d completed=%d paused=%d aborted=%d wrong_frames=%d lamp_on_unsaid=%d "
                "late=%d not_struck=%d",
                &share.faults, &share.completed, &share.paused, &share.aborted, &share.wrong_frames,
                &share.lamp_on_unsaid, &share.late, &share.missed);
    for (std::size_t at = 0; at < last; at = text.find('\n', at) + 1) {
      const std::string line = text.substr(at, text.find('\n', at) + 1 - at);
      if (line.starts_with("usb") || line.starts_with("BAD") || line.starts_with("   "))
        share.table += line;
    }
    return share;
  }

 private:
  FILE* pipe_ = nullptr;
};

/// Tallies, by wire and effect.
struct Tally {
  int faults = 0, completed = 0, paused = 0, aborted = 0, missed = 0;
  double worst = 0;
};

class Campaign {
 public:
  Campaign(Options options, fs::path folder)
      : options_(std::move(options)), folder_(std::move(folder)), kinds_(wire_kinds()) {
    if (!options_.wire.empty())
      std::erase_if(kinds_, [&](const WireKind& kind) { return kind.name != options_.wire; });
    if (kinds_.empty()) die("there is no wire \"" + options_.wire + "\"");
    if (options_.wire.empty() && !sees_usb()) {
      // A fifth of all faults, since there are five wires.
      const int share = options_.count / 5;
      usb_share_ = std::make_unique<UsbChild>(share, options_.seed, options_.verbose);
      options_.count -= share;
    }
    for (const WireKind& kind : kinds_) {
      Bench bench{read_small_rig(kind, folder_, 0), {}, {}, 0, 0, 0};
      bench.spec = *read_session({}, bench.rig).value;
      if (benches_.empty()) {
        auto prepared = prepare(bench.rig, bench.spec);
        if (!prepared) die(prepared.error().message);
        bench.prepared = std::move(*prepared);
      } else {
        bench.prepared = benches_.begin()->second.prepared;  // the same scene behind another wire
      }
      // Without a fault it completes, in a known number of requests.
      const Outcome clean = run_trial(bench, {kind.name, "", 1}, "clean-" + kind.name);
      if (clean.verdict != Verdict::completed || !clean.wrong.empty())
        die(fmt::format("{}: even without a fault: {} {}", kind.name, clean.reason,
                        fmt::join(clean.wrong, "; ")));
      bench.requests = clean.requests;
      bench.frames = clean.frames;
      bench.seconds = clean.seconds;
      std::printf("%s: a session without a fault takes %.1f s and %llu requests\n",
                  kind.name.c_str(), clean.seconds,
                  static_cast<unsigned long long>(clean.requests));
      std::fflush(stdout);
      benches_.emplace(kind.name, std::move(bench));
    }
  }

  /// The faults of the USB wire are another process' share; its figures join ours.
  void also(const UsbShare& share) {
    usb_ = share;
    wrong_ += share.wrong_frames;
    unsaid_ += share.lamp_on_unsaid;
    late_ += share.late;
  }

  bool run() {
    std::vector<std::jthread> workers;
    for (int worker = 0; worker < options_.jobs; ++worker)
      workers.emplace_back([this, worker] { work(worker + 1); });
    workers.clear();
    if (usb_share_) also(usb_share_->wait());
    report();
    return wrong_ == 0 && unsaid_ == 0 && late_ == 0;
  }

 private:
  void work(int worker) {
    std::map<std::string, Bench> mine = benches_;
    for (const WireKind& kind : kinds_)
      mine.at(kind.name).rig = read_small_rig(kind, folder_, worker);
    for (int n = next_++; n < options_.count; n = next_++) {
      const Trial trial =
          draw(options_.seed * 1000003 + static_cast<std::uint64_t>(n), kinds_, mine);
      note(n, trial, run_trial(mine.at(trial.wire), trial, fmt::format("trial-{}", n)));
    }
  }

  void note(int n, const Trial& trial, const Outcome& outcome) {
    const std::lock_guard lock(mutex_);
    Tally& tally = tallies_[{trial.wire, trial.fault.substr(0, trial.fault.find(' '))}];
    ++tally.faults;
    tally.completed += outcome.verdict == Verdict::completed ? 1 : 0;
    tally.paused += outcome.verdict == Verdict::paused ? 1 : 0;
    tally.aborted += outcome.verdict == Verdict::aborted ? 1 : 0;
    tally.missed += outcome.struck ? 0 : 1;
    tally.worst = std::max(tally.worst, outcome.seconds);
    wrong_ += static_cast<int>(outcome.wrong.size());
    unsaid_ += outcome.lamp_on_unsaid ? 1 : 0;
    late_ += outcome.late ? 1 : 0;
    const bool silent = outcome.verdict != Verdict::completed && outcome.reason.empty();
    unsaid_ += silent ? 1 : 0;
    const bool bad = !outcome.wrong.empty() || outcome.lamp_on_unsaid || outcome.late || silent;
    if (!bad && !options_.verbose) return;
    std::printf("%s trial %d, %s: %s -> %s%s%s\n", bad ? "BAD" : "   ", n, trial.wire.c_str(),
                trial.fault.c_str(), outcome.reason.c_str(),
                outcome.lamp_on_unsaid ? "; LAMP ON, UNSAID" : "", outcome.late ? "; LATE" : "");
    for (const std::string& frame : outcome.wrong) std::printf("      WRONG %s\n", frame.c_str());
    std::fflush(stdout);
  }

  void report() const {
    Tally all{usb_.faults, usb_.completed, usb_.paused, usb_.aborted, usb_.missed, 0};
    std::printf("%-6s %-14s %7s %10s %7s %8s %11s %8s\n", "wire", "fault", "trials", "completed",
                "paused", "aborted", "not struck", "worst s");
    for (const auto& [what, tally] : tallies_) {
      std::printf("%-6s %-14s %7d %10d %7d %8d %11d %8.1f\n", what.first.c_str(),
                  what.second.c_str(), tally.faults, tally.completed, tally.paused, tally.aborted,
                  tally.missed, tally.worst);
      all.faults += tally.faults;
      all.completed += tally.completed;
      all.paused += tally.paused;
      all.aborted += tally.aborted;
      all.missed += tally.missed;
    }
    std::printf("%s", usb_.table.c_str());
    std::printf(
        "not_struck: the session was over, or the wire gone, before the fault's moment came\n");
    std::printf(
        "faults=%d completed=%d paused=%d aborted=%d wrong_frames=%d lamp_on_unsaid=%d late=%d "
        "not_struck=%d\n",
        all.faults, all.completed, all.paused, all.aborted, wrong_, unsaid_, late_, all.missed);
  }

  Options options_;
  const fs::path folder_;
  std::vector<WireKind> kinds_;
  std::map<std::string, Bench> benches_;
  std::atomic<int> next_{0};
  std::mutex mutex_;
  std::map<std::pair<std::string, std::string>, Tally> tallies_;
  int wrong_ = 0, unsaid_ = 0, late_ = 0;
  std::unique_ptr<UsbChild> usb_share_;
  UsbShare usb_;
};

}  // namespace
}  // namespace lightrig

int main(int argc, char** argv) {
  using namespace lightrig;
  const Options options = read_options(argc, argv);
  if (const std::string obstacle = test::enter_own_network(); !obstacle.empty())
    std::fprintf(stderr, "fault_campaign: on the host's own loopback: %s\n", obstacle.c_str());
  std::string name = (std::filesystem::temp_directory_path() / "lightrig-campaign-XXXXXX").string();
  const std::filesystem::path folder = mkdtemp(name.data());
  const bool good = Campaign(options, folder).run();
  std::filesystem::remove_all(folder);
  return good ? 0 : 1;
}
