// One session with one fault, through the service itself, over wires only.
#include "tests/campaign/trial.h"

#include <fmt/format.h>
#include <unistd.h>

#include <chrono>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <thread>

#include "config/read_rig.h"
#include "daemon/service/service.h"
#include "sim/hosted_rig.h"
#include "tests/campaign/judge.h"
#include "tests/drivers/own_network.h"
#include "tests/wire/small_wire_rig.h"

namespace lightrig::campaign {
namespace {

namespace fs = std::filesystem;
using namespace std::chrono_literals;
using std::chrono::steady_clock;

constexpr auto look = 5ms;                    ///< between two looks at the service
constexpr auto patience_with_pause = 1500ms;  ///< then the person of this story gives up
constexpr int arming_attempts = 2;  ///< refused for a reason that passes, a person asks again
constexpr auto time_between_armings = 2s;
constexpr auto time_to_rest = 3s;  ///< the longest move of the rig, twice
const Caller person{"campaign", "in process"};

/// A folder that goes when the trial does.
class Scratch {
 public:
  Scratch() {
    std::string name = (fs::temp_directory_path() / "lightrig-campaign-XXXXXX").string();
    if (!mkdtemp(name.data())) die("no temporary folder can be made");
    path_ = name;
  }
  ~Scratch() {
    std::error_code ignored;
    fs::remove_all(path_, ignored);
  }
  Scratch(const Scratch&) = delete;
  Scratch& operator=(const Scratch&) = delete;
  const fs::path& path() const { return path_; }

 private:
  fs::path path_;
};

Rig small_rig(const WireKind& kind, const fs::path& folder) {
  test::SmallWireRig text(kind.rig_file);
  text.sessions_in(folder / "sessions");
  text.replace("tolerance_deg = 0.02", "tolerance_deg = 0.02\nhoming_timeout_ms = 8000");
  if (text.text().find("\ntimeout_ms = ") != std::string::npos) text.set("timeout_ms", "300");
  if (text.text().find("\ndevice = ") != std::string::npos)
    text.set("device", fmt::format("\"{}/device\"", folder.string()));
  // A frame of these few pixels is many packets all the same.
  if (kind.name == "camera")
    text.replace("id = \"127.0.0.1\"\n", "id = \"127.0.0.1\"\npacket_size_bytes = 576\n");
  if (kind.name == "lamp") {  // on a wire of its own
    text.replace("[lamp]\nbackend = \"gantry\"", "[lamp]\nbackend = \"modbus\"");
    text.replace("[lamp.gantry]\noutput = \"lamp\"",
                 "[lamp.modbus]\nhost = \"127.0.0.1\"\nport = 1503\nunit = 5\nholding = 16\n"
                 "full_scale = 1000\ntimeout_ms = 300");
  }
  const fs::path file = folder / "rig.toml";
  std::ofstream(file) << text.text();
  auto read = read_rig(file);
  for (const Diagnostic& one : read.diagnostics)
    std::fprintf(stderr, "%s\n", to_text(one, read.text).c_str());
  if (!read.value) die("the small rig is not valid");
  return std::move(*read.value);
}

/// What a session was doing, in a word.
std::string phase_of(const Snapshot& now) {
  if (now.state == State::unarmed || now.state == State::armed) return "arming";
  if (now.state == State::planning || now.state == State::reducing || now.state == State::done)
    return std::string(name_of(now.state));
  const std::string& doing = now.session ? now.session->progress.activity : "";
  if (doing.starts_with("hom")) return "homing";
  if (doing.starts_with("dark")) return "dark frames";
  if (doing.starts_with("moving")) return "moving";
  if (doing.starts_with("warming")) return "lamp";
  if (doing.starts_with("ambient") || doing.starts_with("metering") ||
      doing.starts_with("exposing"))
    return "exposing";
  return "other";
}

/// The person at the rig: arms it, starts a session, resumes what paused once its cause is gone,
/// and gives up when it is not.
class Person {
 public:
  Person(const WireKind& kind, double patience, sim::HostedRig& hosted, const Rig& rig)
      : stated_(patience * kind.stated_s),
        kind_(kind),
        hosted_(hosted),
        service_({rig, false, 1, 1}, log_, hub_, liveness_) {
    const auto spec = read_session({}, rig);
    if (!spec.value) die("the small rig's session is not valid");
    spec_ = *spec.value;
  }

  Outcome take_session() {
    for (int attempt = 0; attempt < arming_attempts && !is_armed(service_.snapshot().state);
         ++attempt) {
      if (attempt > 0) std::this_thread::sleep_for(time_between_armings);
      if (!command(service_.arm(person))) break;
    }
    if (service_.snapshot().state != State::armed)
      return ended("aborted", fmt::format("arming: {}", last_message()));
    if (auto started = service_.start(person, {spec_, {}, ""}); !started)
      return ended("aborted", started.error().message);
    while (!is_over()) {
      see(service_.snapshot());
      std::this_thread::sleep_for(look);
    }
    const Snapshot end = service_.snapshot();
    const std::string reason = end.session ? end.session->reason : "";
    if (end.state == State::reducing || end.state == State::done) return ended("completed", "");
    return ended(end.state == State::paused ? "paused" : "aborted", reason);
  }

  /// False while the service computes what nobody waits for.
  bool shut_down() {
    if (service_.snapshot().state == State::reducing) return false;
    service_.shut_down();
    return true;
  }

 private:
  /// Within the trial's stated time a session ends by itself; then it is aborted, and late.
  bool is_over() {
    const Snapshot now = service_.snapshot();
    // What follows the capture is arithmetic: it touches no wire, and takes most of the time.
    if (now.state == State::reducing) return true;
    if (!now.busy && now.state != State::planning) return true;
    if (!late_ && steady_clock::now() - began_ > stated_) {
      late_ = true;
      service_.abort(person, "the campaign's own limit");
    }
    return false;
  }

  bool command(const Result<std::uint64_t>& asked) {
    if (!asked) return false;
    while (service_.snapshot().busy) {
      see(service_.snapshot());
      std::this_thread::sleep_for(look);
    }
    return true;
  }

  std::string last_message() const {
    const auto commands = service_.snapshot().commands;
    return commands.empty() ? "refused" : commands.back().message;
  }

  void see(const Snapshot& now) {
    if (phase_.empty() && !hosted_.struck().empty()) phase_ = last_phase_;
    if (now.state != State::paused) last_phase_ = phase_of(now);
    if (now.state != State::paused) return since_.reset();
    const std::string id = now.session ? now.session->id : "";
    if (hosted_.world->gantry_status().open_interlocks.empty())
      return static_cast<void>(service_.steer(person, id, SessionVerb::resume));
    if (!since_) since_ = steady_clock::now();
    if (steady_clock::now() - *since_ > patience_with_pause)
      static_cast<void>(service_.steer(person, id, SessionVerb::halt));
  }

  /// What holds at the end of every session, however it ended.
  Outcome ended(std::string verdict, std::string reason) {
    Outcome outcome;
    const Snapshot now = service_.snapshot();
    outcome.verdict = std::move(verdict);
    outcome.reason = std::move(reason);
    outcome.phase = hosted_.struck().empty() ? "" : phase_.empty() ? last_phase_ : phase_;
    outcome.counts.seconds = std::chrono::duration<double>(steady_clock::now() - began_).count();
    const auto violated = [&](const std::string& what) { outcome.violations.push_back(what); };
    if (late_) {
      outcome.late = 1;
      violated(fmt::format("it had not ended by itself after {:.0f} s", stated_.count()));
    }
    const bool lit = hosted_.world->lamp_power() > 0;
    if ((lit && !now.lamp_may_be_on) || (now.lamp_may_be_on && is_armed(now.state))) {
      outcome.lamp_on_unsaid = 1;
      violated(fmt::format("the lamp is {}, said to be {}, the rig {}", lit ? "on" : "dark",
                           now.lamp_may_be_on ? "possibly on" : "dark", name_of(now.state)));
    }
    if (outcome.verdict != "completed" && outcome.reason.empty())
      violated("it ended without a reason");
    const auto rest = steady_clock::now() + time_to_rest;
    while (!hosted_.world->gantry_status().at_rest && steady_clock::now() < rest)
      std::this_thread::sleep_for(look);
    if (!hosted_.world->gantry_status().at_rest) violated("the gantry still moves");
    outcome.counts.frames = hosted_.camera_faults->frames();
    outcome.counts.packets_lost = hosted_.camera_faults->packets_lost();
    outcome.counts.requests =
        hosted_.faults->requests(kind_.name == "lamp" ? sim::Wire::lamp : sim::Wire::gantry);
    outcome.counts.shots =
        now.session ? static_cast<std::uint64_t>(now.session->progress.shots_total) : 0;
    return outcome;
  }

  const std::chrono::duration<double> stated_;
  const WireKind& kind_;
  sim::HostedRig& hosted_;
  const steady_clock::time_point began_ = steady_clock::now();
  Log log_{LogLevel::info, Log::Sink::none};
  EventHub hub_;
  Liveness liveness_;
  SessionSpec spec_;
  std::string phase_, last_phase_ = "arming";
  bool late_ = false;
  std::optional<steady_clock::time_point> since_;
  Service service_;
};

}  // namespace

Outcome run_trial(const Trial& trial, double patience) {
  // Each trial has its own loopback: addresses are the shipped files' own.
  if (const std::string obstacle = test::enter_own_network(); !obstacle.empty()) die(obstacle);
  const WireKind& kind = wire_kind(trial.wire);
  const Scratch scratch;
  const Rig rig = small_rig(kind, scratch.path());
  auto hosted = sim::host_rig(rig, rig.session_defaults.object, trial.seed);
  if (!hosted) die(hosted.error().message);
  if (!trial.fault.empty())
    if (auto added = hosted->add_fault(trial.fault); !added) die(added.error().message);
  auto at_the_rig = std::make_unique<Person>(kind, patience, *hosted, rig);
  Outcome outcome = at_the_rig->take_session();
  // The process ends with the trial, and with it what is left computing.
  if (!at_the_rig->shut_down()) static_cast<void>(at_the_rig.release());
  std::error_code none;
  for (const auto& entry : fs::directory_iterator(scratch.path() / "sessions", none)) {
    if (!entry.is_directory()) continue;
    for (const std::string& wrong : Judge(rig, *hosted->world).wrong_frames(entry.path())) {
      ++outcome.wrong_frames;
      outcome.violations.push_back(wrong);
    }
  }
  // Wires that the service left behind still listens to are not closed under it.
  if (at_the_rig == nullptr)
    static_cast<void>(new sim::HostedRig(std::move(*hosted)));  // NOLINT: see above
  return outcome;
}

std::string to_json(const Outcome& o) {
  return nlohmann::ordered_json{{"verdict", o.verdict},
                                {"reason", o.reason},
                                {"phase", o.phase},
                                {"violations", o.violations},
                                {"wrong_frames", o.wrong_frames},
                                {"lamp_on_unsaid", o.lamp_on_unsaid},
                                {"late", o.late},
                                {"requests", o.counts.requests},
                                {"frames", o.counts.frames},
                                {"shots", o.counts.shots},
                                {"packets_lost", o.counts.packets_lost},
                                {"seconds", o.counts.seconds}}
      .dump();
}

std::optional<Outcome> outcome_from(const std::string& text) {
  const auto json = nlohmann::json::parse(text, nullptr, false);
  if (!json.is_object()) return std::nullopt;
  Outcome o;
  o.verdict = json.value("verdict", "died");
  o.reason = json.value("reason", "");
  o.phase = json.value("phase", "");
  o.violations = json.value("violations", std::vector<std::string>{});
  o.wrong_frames = json.value("wrong_frames", 0);
  o.lamp_on_unsaid = json.value("lamp_on_unsaid", 0);
  o.late = json.value("late", 0);
  o.counts = {json.value("requests", std::uint64_t{0}), json.value("frames", std::uint64_t{0}),
              json.value("shots", std::uint64_t{0}), json.value("packets_lost", std::uint64_t{0}),
              json.value("seconds", 0.0)};
  return o;
}

}  // namespace lightrig::campaign
