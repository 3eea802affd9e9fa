// commission: what must be proven before a rig is trusted, one by one, and recorded.
#include <fmt/chrono.h>
#include <fmt/format.h>
#include <unistd.h>

#include <chrono>
#include <cmath>
#include <cstdio>
#include <functional>
#include <thread>

#include "cli/drive_watchdog.h"
#include "cli/findings.h"
#include "cli/rig_under_test.h"
#include "cli/say.h"
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

std::string now_utc() {
  const auto now = std::chrono::system_clock::to_time_t(std::chrono::system_clock::now());
  return fmt::format("{:%Y-%m-%dT%H:%M:%SZ}", fmt::gmtime(now));
}

/// One rig being commissioned: its checks in order, and their record.
class Commissioning {
 public:
  explicit Commissioning(const CommissionOptions& options)
      : rig_(options), try_watchdog_(options.try_watchdog) {}

  /// Errors: the service does not answer. A check that fails is no error; the rig is left unarmed.
  Result<Json> run() {
    if (auto there = rig_.look(); !there) return tl::unexpected(there.error());
    check("starts unarmed", "the service is asked", [this] { return unarmed(); });
    check("moves nothing before homing", "a small move is asked for",
          [this] { return not_before_homing(); });
    check("homing", "the gantry is homed", [this] { return homing(); });
    for (const Json& axis : rig_.facts()["axes"]) {
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
          [this] { return drive_watchdog(rig_, try_watchdog_); });
    for (const Json& interlock : rig_.facts()["interlocks"])
      check("interlock " + interlock.get<std::string>(), "it is opened by hand",
            [&] { return interlock_opens(interlock.get<std::string>()); });
    check("left unarmed", "the rig is disarmed", [this] { return unarmed(); });
    Json record{{"schema", "lightrig.commissioning/2"},
                {"rig", rig_.facts()["name"]},
                {"rig_sha256", sha256_hex(text(rig_.facts(), "text"))},
                {"at", now_utc()},
                {"asked_a_person", rig_.asks()}};
    record.update(findings_.json());
    return record;
  }
  const Findings& findings() const { return findings_; }

 private:
  void check(const std::string& name, const std::string& how, const std::function<Finding()>& run) {
    fmt::print(rig_.out(), "{}: {} …\n", name, how);
    std::fflush(rig_.out());
    const Finding found = run();
    fmt::print(rig_.out(), "  {}: {}\n", word_of(found.outcome), found.what);
    findings_.add(name, how, found, now_utc());
  }

  Finding unarmed() {
    const Json now = rig_.status();
    if (text(now, "state") == "unarmed") return passed("it is unarmed, no device is open");
    if (auto done = rig_.carry_out("/v1/disarm"); !done) return failed(done.error().message);
    return passed("it was " + text(now, "state") + " and let itself be disarmed");
  }

  Finding not_before_homing() {
    const auto early = rig_.carry_out("/v1/home");
    if (early) return failed("it homed although the rig was not armed");
    if (auto done = rig_.armed(); !done) return failed(done.error().message);
    if (part(part(rig_.status(), "devices"), "gantry").value("homed", false))
      return not_proven("the controller says that it is homed already; not moved while unarmed: " +
                        early.error().message);
    const auto moved =
        rig_.move_to(rig_.facts()["axes"][0], rig_.facts()["axes"][0]["home"].get<double>());
    return moved ? failed("it moved without being homed") : passed(moved.error().message);
  }

  Finding homing() {
    if (!rig_.person_says("Is everybody clear of the arm, and a hand on the emergency stop?"))
      return failed("a person says that it is not safe to home");
    const auto begun = SteadyClock::now();
    if (auto done = rig_.carry_out("/v1/home"); !done) return failed(done.error().message);
    const double seconds = std::chrono::duration<double>(SteadyClock::now() - begun).count();
    return rig_.seen(fmt::format("homed in {:.1f} s", seconds),
                     "Did every axis find its switch, slowly?");
  }

  Finding direction(const Json& axis) {
    const std::string name = text(axis, "name"), unit = text(axis, "unit");
    const double from = rig_.position(name), step = step_of(unit);
    // Towards the side where there is room.
    const double sign = from + step <= axis["max"].get<double>() ? 1 : -1;
    if (auto done = rig_.move_to(axis, from + sign * step); !done)
      return failed(done.error().message);
    const double at = rig_.position(name);
    if (!(std::abs(at - from - sign * step) <= off_by))
      return failed(
          fmt::format("told to go to {:.3f} {}, it says {:.3f}", from + sign * step, unit, at));
    const Finding found =
        rig_.seen(fmt::format("moved from {:.3f} to {:.3f} {}", from, at, unit),
                  fmt::format("Did {} move towards its {} side, by about {} {}?", name,
                              sign > 0 ? "greater" : "smaller", step, unit));
    if (auto back = rig_.move_to(axis, from); !back)
      return failed("on the way back: " + back.error().message);
    return found;
  }

  Finding limits(const Json& axis) {
    const std::string name = text(axis, "name");
    const double before = rig_.position(name);
    for (const double beyond : {axis["min"].get<double>() - 1, axis["max"].get<double>() + 1})
      if (rig_.move_to(axis, beyond))
        return failed(
            fmt::format("it went to {} {}, beyond its travel", beyond, text(axis, "unit")));
    const double moved = std::abs(rig_.position(name) - before);
    return moved <= off_by ? passed(fmt::format("{} and {} {} were refused, it did not move",
                                                axis["min"].get<double>() - 1,
                                                axis["max"].get<double>() + 1, text(axis, "unit")))
                           : failed(fmt::format("refused, but it moved by {:.3f}", moved));
  }

  Finding abort_in_motion() {
    const auto moving = rig_.long_move();
    if (!moving) return not_proven("nothing moves on this rig");
    const Result<Json>& reply = *moving;
    if (!reply) return failed(reply.error().message);
    std::this_thread::sleep_for(200ms);
    if (!rig_.status().value("busy", false))
      return failed("the move had ended, or never began, before it could be aborted");
    const auto asked = SteadyClock::now();
    if (auto aborted = rig_.post("/v1/abort", {{"reason", "commissioning"}}); !aborted)
      return failed(aborted.error().message);
    const auto end = rig_.wait_for(reply->value("command", std::uint64_t{0}));
    const double ms = 1e3 * std::chrono::duration<double>(SteadyClock::now() - asked).count();
    if (end) return failed("the move arrived although it was aborted");
    return rig_.seen(
        fmt::format("the move ended {:.0f} ms after ABORT was asked for, the rig is {}", ms,
                    text(rig_.status(), "state")),
        "Did the arm stop at once, and did it hold?");
  }

  Finding still_after_abort() {
    const auto moved = rig_.carry_out("/v1/home");
    return moved ? failed("it homed although nobody had armed the rig again")
                 : passed(moved.error().message);
  }

  Finding lamp_off() {
    if (auto done = rig_.armed(); !done) return failed(done.error().message);
    const auto lit = rig_.carry_out("/v1/lamp", {{"power", rig_.power()}});
    if (!lit) return failed(lit.error().message);
    if (!rig_.person_says("Is the lamp lit?"))
      return failed("a person says that the lamp did not light");
    if (auto done = rig_.carry_out("/v1/disarm"); !done) return failed(done.error().message);
    // The devices are closed after the command has ended.
    for (int i = 0; i < 100 && !part(rig_.status(), "devices").is_null(); ++i)
      std::this_thread::sleep_for(50ms);
    if (rig_.status().value("lamp_may_be_on", true))
      return failed("the lamp could not be made dark: LAMP MAY BE ON");
    return rig_.seen(*lit + ", then disarmed", "Is the lamp dark?");
  }

  Finding lamp_watchdog() {
    const double lease = rig_.facts()["lamp"]["max_on_time_s"].get<double>();
    if (auto done = rig_.armed(); !done) return failed(done.error().message);
    if (auto lit = rig_.carry_out("/v1/lamp", {{"power", rig_.power()}}); !lit)
      return failed(lit.error().message);
    // An idle rig is looked at every two seconds. Where the lamp can be read, it is waited for;
    // where not, a person is asked when it must have gone dark.
    const auto latest = SteadyClock::now() + std::chrono::duration<double>(lease) + 5s;
    Json lamp;
    double power = 1;
    do {
      std::this_thread::sleep_for(100ms);
      lamp = part(part(rig_.status(), "devices"), "lamp");
      power = number(lamp, "power");
    } while (SteadyClock::now() < latest && !(lamp.value("confirmed", false) && power <= 0));
    if (lamp.value("confirmed", false) && !(power <= 0))
      return failed(fmt::format("after {} s without renewal it still reads {:.2f}", lease, power));
    return rig_.seen(
        fmt::format("after {} s without renewal it {}", lease,
                    lamp.value("confirmed", false) ? "reads dark" : "cannot be read back"),
        "Has the lamp gone dark by itself?");
  }

  Finding interlock_opens(const std::string& name) {
    if (!rig_.asks()) return not_proven("it takes a hand");
    if (auto done = rig_.armed_and_homed(); !done) return failed(done.error().message);
    if (!rig_.person_says("Open " + name + ", then answer y. Is it open?"))
      return failed("a person did not open it");
    std::this_thread::sleep_for(5s);
    const auto moved =
        rig_.move_to(rig_.facts()["axes"][0], rig_.facts()["axes"][0]["home"].get<double>());
    (void)rig_.person_says("Close " + name + " again, then answer y. Is it closed?");
    return moved ? failed("the gantry moved with " + name + " open")
                 : passed(moved.error().message);
  }

  RigUnderTest rig_;
  bool try_watchdog_;
  Findings findings_;
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
    say(fmt::format("{}\nthe record is {}", commissioning.findings().verdict(), file));
  return commissioning.findings().all_it_has() ? 0 : 1;
}

}  // namespace lightrig::cli
