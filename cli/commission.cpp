// commission: what must be proven before a rig is trusted, one by one, and recorded.
#include <fmt/chrono.h>
#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <functional>
#include <iostream>
#include <numbers>
#include <optional>
#include <thread>

#include "cli/held_process.h"
#include "cli/json_fields.h"
#include "cli/say.h"
#include "cli/service_client.h"
#include "cli/verbs.h"
#include "config/json_text.h"
#include "daemon/session/durable_file.h"

namespace lightrig::cli {
namespace {

using namespace std::chrono_literals;
using SteadyClock = std::chrono::steady_clock;

constexpr double off_by = 0.1;  ///< [deg or mm] a read-back may differ by this much

/// Travel by which a direction is shown: degrees, millimetres, or the next lamp.
double step_of(const std::string& unit) { return unit == "deg" ? 5 : unit == "mm" ? 20 : 1; }

/// What one check found. What nobody saw and nothing measured is not proven, and no pass; what the
/// rig has not got is absent, and said to be.
struct Finding {
  enum class Outcome : std::uint8_t { passed, failed, not_proven, absent } outcome;
  std::string what;
};
constexpr double longest_hold = 20;  // [s] systemd's watchdog takes 30

Finding passed(std::string what) { return {Finding::Outcome::passed, std::move(what)}; }
Finding failed(std::string what) { return {Finding::Outcome::failed, std::move(what)}; }
Finding absent(std::string what) { return {Finding::Outcome::absent, std::move(what)}; }
Finding not_proven(std::string what) { return {Finding::Outcome::not_proven, std::move(what)}; }

/// One rig being commissioned: its checks in order, and their record.
class Commissioning {
 public:
  explicit Commissioning(const CommissionOptions& options)
      : client_(options.service),
        out_(options.service.json ? stderr : stdout),
        ask_(!options.yes),
        try_watchdog_(options.try_watchdog) {}

  /// Errors: the service does not answer. A check that fails is no error; the rig is left unarmed.
  Result<Json> run() {
    auto rig = client_.get_json("/v1/rig");
    if (!rig) return tl::unexpected(rig.error());
    rig_ = std::move(*rig);
    check("starts unarmed", "the service is asked", [this] { return unarmed(); });
    check("moves nothing before homing", "a small move is asked for",
          [this] { return not_before_homing(); });
    check("homing", "the gantry is homed", [this] { return homing(); });
    for (const Json& axis : rig_["axes"]) {
      const std::string name = text(axis, "name");
      check("direction of " + name, "it is moved a little and read back",
            [&] { return direction(axis); });
      check("limits of " + name, "a position beyond each end is asked for",
            [&] { return limits(axis); });
    }
    check("ABORT during a move", "a long move is aborted", [this] { return abort_in_motion(); });
    check("nothing moves after ABORT", "homing is asked for",
          [this] { return still_after_abort(); });
    check("lamp off", "the lamp is lit, then the rig is disarmed", [this] { return lamp_off(); });
    check("watchdog of the lamp", "the lamp is lit and not renewed",
          [this] { return lamp_watchdog(); });
    check("watchdog of the drives",
          "the service is held in a move, the lamp lit, and feeds nothing",
          [this] { return drive_watchdog(); });
    for (const Json& interlock : rig_["interlocks"])
      check("interlock " + interlock.get<std::string>(), "it is opened by hand",
            [&] { return interlock_opens(interlock.get<std::string>()); });
    check("left unarmed", "the rig is disarmed", [this] { return unarmed(); });
    return Json{{"schema", "lightrig.commissioning/1"},
                {"rig", rig_["name"]},
                {"rig_sha256", sha256_hex(text(rig_, "text"))},
                {"at", now_utc()},
                {"asked_a_person", ask_},
                {"passed", failures_ == 0 && unproven_ == 0},
                {"checks", checks_}};
  }
  int failures() const { return failures_; }
  int unproven() const { return unproven_; }

 private:
  static std::string now_utc() {
    const auto now = std::chrono::system_clock::to_time_t(std::chrono::system_clock::now());
    return fmt::format("{:%Y-%m-%dT%H:%M:%SZ}", fmt::gmtime(now));
  }

  void check(const std::string& name, const std::string& how, const std::function<Finding()>& run) {
    fmt::print(out_, "{}: {} …\n", name, how);
    std::fflush(out_);
    const Finding found = run();
    failures_ += found.outcome == Finding::Outcome::failed ? 1 : 0;
    unproven_ += found.outcome == Finding::Outcome::not_proven ? 1 : 0;
    const char* outcome = found.outcome == Finding::Outcome::passed   ? "passed"
                          : found.outcome == Finding::Outcome::failed ? "FAILED"
                          : found.outcome == Finding::Outcome::absent ? "absent"
                                                                      : "not proven";
    fmt::print(out_, "  {}: {}\n", outcome, found.what);
    checks_.push_back({{"check", name},
                       {"how", how},
                       {"outcome", outcome},
                       {"found", found.what},
                       {"at", now_utc()}});
  }

  /// A person's answer; without a person, go on.
  bool person_says(const std::string& question) {
    if (!ask_) return true;
    fmt::print(out_, "  {} [y/n] ", question);
    std::fflush(out_);
    std::string answer;
    return std::getline(std::cin, answer) && !answer.empty() &&
           (answer[0] == 'y' || answer[0] == 'Y');
  }
  /// What only eyes can tell is not proven without them.
  Finding seen(const std::string& measured, const std::string& question) {
    if (!ask_) return not_proven(measured + "; nobody was asked: " + question);
    return person_says(question) ? passed(measured + "; seen by a person")
                                 : failed(measured + "; but a person says no: " + question);
  }

  Result<std::string> carry_out(const std::string& path, const Json& body = Json::object()) {
    const auto reply = client_.post(path, body);
    if (!reply) return tl::unexpected(reply.error());
    return client_.wait_for(reply->value("command", std::uint64_t{0}));
  }
  Json status() { return client_.get_json("/v1/status").value_or(Json::object()); }
  Result<std::string> armed() {
    if (status().value("armed", false)) return std::string();
    return carry_out("/v1/arm");
  }
  Result<std::string> armed_and_homed() {
    if (auto done = armed(); !done) return done;
    const Json now = status();
    if (part(part(now, "devices"), "gantry").value("homed", false)) return std::string();
    return carry_out("/v1/home");
  }
  /// Where an axis stands, in the unit of the rig file.
  double position(const std::string& name) {
    const Json now = status();
    const Json& at = part(part(part(now, "devices"), "gantry"), "position");
    for (std::size_t i = 0; i < rig_["axes"].size(); ++i)
      if (text(rig_["axes"][i], "name") == name && at.is_array() && i < at.size() &&
          at[i].is_number())
        return at[i].get<double>() * per_si(text(rig_["axes"][i], "unit"));
    return std::nan("");
  }
  Result<std::string> move_to(const Json& axis, double to) {
    return carry_out("/v1/jog", {{"axis", text(axis, "name")}, {to_member(axis), to}});
  }

  static double per_si(const std::string& unit) {
    return unit == "deg" ? 180 / std::numbers::pi : unit == "mm" ? 1e3 : 1;
  }
  static std::string to_member(const Json& axis) {
    return text(axis, "unit").empty() ? "to" : fmt::format("to_{}", text(axis, "unit"));
  }

  Finding unarmed() {
    const Json now = status();
    if (text(now, "state") == "unarmed") return passed("it is unarmed, no device is open");
    if (auto done = carry_out("/v1/disarm"); !done) return failed(done.error().message);
    return passed("it was " + text(now, "state") + " and let itself be disarmed");
  }

  Finding not_before_homing() {
    const auto early = carry_out("/v1/home");
    if (early) return failed("it homed although the rig was not armed");
    if (auto done = armed(); !done) return failed(done.error().message);
    if (part(part(status(), "devices"), "gantry").value("homed", false))
      return not_proven("the controller says that it is homed already; not moved while unarmed: " +
                        early.error().message);
    const auto moved = move_to(rig_["axes"][0], rig_["axes"][0]["home"].get<double>());
    return moved ? failed("it moved without being homed") : passed(moved.error().message);
  }

  Finding homing() {
    if (!person_says("Is everybody clear of the arm, and a hand on the emergency stop?"))
      return failed("a person says that it is not safe to home");
    const auto begun = SteadyClock::now();
    if (auto done = carry_out("/v1/home"); !done) return failed(done.error().message);
    const double seconds = std::chrono::duration<double>(SteadyClock::now() - begun).count();
    return seen(fmt::format("homed in {:.1f} s", seconds),
                "Did every axis find its switch, slowly?");
  }

  Finding direction(const Json& axis) {
    const std::string name = text(axis, "name"), unit = text(axis, "unit");
    const double from = position(name), step = step_of(unit);
    // Towards the side where there is room.
    const double sign = from + step <= axis["max"].get<double>() ? 1 : -1;
    if (auto done = move_to(axis, from + sign * step); !done) return failed(done.error().message);
    const double at = position(name);
    if (!(std::abs(at - from - sign * step) <= off_by))
      return failed(
          fmt::format("told to go to {:.3f} {}, it says {:.3f}", from + sign * step, unit, at));
    const Finding found = seen(fmt::format("moved from {:.3f} to {:.3f} {}", from, at, unit),
                               fmt::format("Did {} move towards its {} side, by about {} {}?", name,
                                           sign > 0 ? "greater" : "smaller", step, unit));
    if (auto back = move_to(axis, from); !back)
      return failed("on the way back: " + back.error().message);
    return found;
  }

  Finding limits(const Json& axis) {
    const std::string name = text(axis, "name");
    const double before = position(name);
    for (const double beyond : {axis["min"].get<double>() - 1, axis["max"].get<double>() + 1})
      if (move_to(axis, beyond))
        return failed(
            fmt::format("it went to {} {}, beyond its travel", beyond, text(axis, "unit")));
    const double moved = std::abs(position(name) - before);
    return moved <= off_by ? passed(fmt::format("{} and {} {} were refused, it did not move",
                                                axis["min"].get<double>() - 1,
                                                axis["max"].get<double>() + 1, text(axis, "unit")))
                           : failed(fmt::format("refused, but it moved by {:.3f}", moved));
  }

  /// The longest move that the first moving axis has, under way; empty where nothing moves.
  std::optional<Result<Json>> long_move() {
    const auto moving = std::ranges::find_if(
        rig_["axes"], [](const Json& one) { return !text(one, "unit").empty(); });
    if (moving == rig_["axes"].end()) return {};
    const Json& axis = *moving;
    const std::string name = text(axis, "name");
    const double from = position(name), low = axis["min"].get<double>(),
                 high = axis["max"].get<double>();
    const double to = high - from > from - low ? high : low;
    return client_.post("/v1/jog", {{"axis", name}, {to_member(axis), to}});
  }

  Finding abort_in_motion() {
    const auto moving = long_move();
    if (!moving) return not_proven("nothing moves on this rig");
    const Result<Json>& reply = *moving;
    if (!reply) return failed(reply.error().message);
    std::this_thread::sleep_for(200ms);
    if (!status().value("busy", false))
      return failed("the move had ended, or never began, before it could be aborted");
    const auto asked = SteadyClock::now();
    if (auto aborted = client_.post("/v1/abort", {{"reason", "commissioning"}}); !aborted)
      return failed(aborted.error().message);
    const auto end = client_.wait_for(reply->value("command", std::uint64_t{0}));
    const double ms = 1e3 * std::chrono::duration<double>(SteadyClock::now() - asked).count();
    if (end) return failed("the move arrived although it was aborted");
    return seen(fmt::format("the move ended {:.0f} ms after ABORT was asked for, the rig is {}", ms,
                            text(status(), "state")),
                "Did the arm stop at once, and did it hold?");
  }

  Finding still_after_abort() {
    const auto moved = carry_out("/v1/home");
    return moved ? failed("it homed although nobody had armed the rig again")
                 : passed(moved.error().message);
  }

  Finding lamp_off() {
    if (auto done = armed(); !done) return failed(done.error().message);
    const auto lit = carry_out("/v1/lamp", {{"power", rig_["lamp"]["power"]}});
    if (!lit) return failed(lit.error().message);
    if (!person_says("Is the lamp lit?"))
      return failed("a person says that the lamp did not light");
    if (auto done = carry_out("/v1/disarm"); !done) return failed(done.error().message);
    // The devices are closed after the command has ended.
    for (int i = 0; i < 100 && !part(status(), "devices").is_null(); ++i)
      std::this_thread::sleep_for(50ms);
    if (status().value("lamp_may_be_on", true))
      return failed("the lamp could not be made dark: LAMP MAY BE ON");
    return seen(*lit + ", then disarmed", "Is the lamp dark?");
  }

  Finding lamp_watchdog() {
    const double lease = rig_["lamp"]["max_on_time_s"].get<double>();
    if (auto done = armed(); !done) return failed(done.error().message);
    if (auto lit = carry_out("/v1/lamp", {{"power", rig_["lamp"]["power"]}}); !lit)
      return failed(lit.error().message);
    // An idle rig is looked at every two seconds. Where the lamp can be read, it is waited for;
    // where not, a person is asked when it must have gone dark.
    const auto latest = SteadyClock::now() + std::chrono::duration<double>(lease) + 5s;
    Json lamp;
    double power = 1;
    do {
      std::this_thread::sleep_for(100ms);
      lamp = part(part(status(), "devices"), "lamp");
      power = number(lamp, "power");
    } while (SteadyClock::now() < latest && !(lamp.value("confirmed", false) && power <= 0));
    if (lamp.value("confirmed", false) && !(power <= 0))
      return failed(fmt::format("after {} s without renewal it still reads {:.2f}", lease, power));
    return seen(fmt::format("after {} s without renewal it {}", lease,
                            lamp.value("confirmed", false) ? "reads dark" : "cannot be read back"),
                "Has the lamp gone dark by itself?");
  }

  /// The drives' own dead man: a service that hangs asks them nothing any more.
  Finding drive_watchdog() {
    const double patience = number(rig_, "drive_watchdog_s");
    if (!std::isfinite(patience))
      return absent(
          "these drives have none that the rig file names: a service that hangs leaves the arm to "
          "end its move and the lamp lit until systemd's watchdog ends it; have a hard-wired stop");
    // While the service is held nothing of it protects anybody.
    if (!ask_ && !try_watchdog_)
      return not_proven(
          "it takes a hand on the emergency stop: while the service is held its ABORT does "
          "nothing. "
          "--try-watchdog does it unasked");
    if (patience > longest_hold)
      return not_proven(
          fmt::format("{:.0f} s of silence are more than the service may be held, {:.0f} s, before "
                      "systemd ends "
                      "it: shorten the watchdog",
                      patience, longest_hold));
    const auto process = static_cast<pid_t>(whole(rig_, "process"));
    if (process <= 1 || !is_service(process))
      return not_proven("the service is no process of this machine that could be held");
    if (const std::string why = why_not_held(process); !why.empty())
      return not_proven(fmt::format(
          "the service (process {}) cannot be held: {}; run lightrig commission as root", process,
          why));
    if (auto ready = armed_and_homed(); !ready) return failed(ready.error().message);
    if (!person_says(fmt::format(
            "The arm will move with the lamp lit while the service is held for {:.0f} s: ABORT, "
            "door "
            "and lease do nothing meanwhile, and the drives must stop by themselves. Is everybody "
            "clear, and a hand on the emergency stop?",
            patience + 1)))
      return failed("a person says that it is not safe to move");
    if (auto lit = carry_out("/v1/lamp", {{"power", rig_["lamp"]["power"]}}); !lit)
      return failed(lit.error().message);
    const auto moving = long_move();
    std::this_thread::sleep_for(500ms);  // up to speed
    std::string why;
    if (moving && !*moving) why = moving->error().message;
    if (why.empty() && !status().value("busy", false)) why = "the move was over before it was held";
    if (why.empty()) {
      const HeldProcess held(process, std::chrono::duration<double>(patience) + 3s);
      why = held.why_not();
      if (why.empty()) std::this_thread::sleep_for(std::chrono::duration<double>(patience) + 1s);
    }
    if (!why.empty()) {  // nothing is left lit or moving
      (void)client_.post("/v1/abort", {{"reason", "commissioning"}});
      return not_proven(why);
    }
    // Let go on, the service hears of it from the drives: their alarm is the proof.
    const auto latest = SteadyClock::now() + 30s;
    Json now = status();
    while (SteadyClock::now() < latest && text(now, "state") != "faulted") {
      std::this_thread::sleep_for(100ms);
      now = status();
    }
    if (text(now, "state") != "faulted") {
      (void)client_.post("/v1/abort", {{"reason", "commissioning"}});
      return failed(
          fmt::format("held for {:.1f} s, which is longer than the {:.1f} s of their "
                      "watchdog, and the drives say nothing of it",
                      patience + 1, patience));
    }
    std::string said;
    for (const Json& reason : part(now, "why_not_ready"))
      said += (said.empty() ? "" : "; ") + reason.get<std::string>();
    if (auto cleared = carry_out("/v1/clear"); !cleared) return failed(cleared.error().message);
    if (said.find("alarm") == std::string::npos)
      return failed("the rig faulted, but by no alarm of the drives: " + said);
    return seen(fmt::format("held for {:.1f} s: {}", patience + 1, said),
                "Did the arm stop by itself, and did the lamp go dark?");
  }

  Finding interlock_opens(const std::string& name) {
    if (!ask_) return not_proven("it takes a hand");
    if (auto done = armed_and_homed(); !done) return failed(done.error().message);
    if (!person_says("Open " + name + ", then answer y. Is it open?"))
      return failed("a person did not open it");
    std::this_thread::sleep_for(5s);
    const auto moved = move_to(rig_["axes"][0], rig_["axes"][0]["home"].get<double>());
    (void)person_says("Close " + name + " again, then answer y. Is it closed?");
    return moved ? failed("the gantry moved with " + name + " open")
                 : passed(moved.error().message);
  }

  ServiceClient client_;
  std::FILE* out_;  ///< what is said on the way: with --json the record alone is the output
  bool ask_, try_watchdog_;
  Json rig_;
  Json checks_ = Json::array();
  int failures_ = 0, unproven_ = 0;
};

}  // namespace

int commission(const CommissionOptions& options) {
  if (!options.yes && isatty(STDIN_FILENO) == 0)
    return complain(
        "commission asks a person at every step: run it in a terminal, or say --yes to prove what "
        "needs no eyes");
  Commissioning commissioning(options);
  const auto record = commissioning.run();
  if (!record) return complain(record.error());
  const std::string file =
      options.output.empty()
          ? fmt::format(
                "commissioning-{:%Y%m%dT%H%M%SZ}.json",
                fmt::gmtime(std::chrono::system_clock::to_time_t(std::chrono::system_clock::now())))
          : options.output;
  if (auto written = write_durably(file, json_text(*record, 1) + "\n"); !written)
    return complain(written.error());
  if (options.service.json)
    say(json_text(*record));
  else
    say(fmt::format("{} of {} checks failed, {} are not proven; the record is {}",
                    commissioning.failures(), (*record)["checks"].size(), commissioning.unproven(),
                    file));
  return part(*record, "passed") == true ? 0 : 1;
}

}  // namespace lightrig::cli
