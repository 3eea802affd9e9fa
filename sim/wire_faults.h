#pragma once

#include <array>
#include <chrono>
#include <cstdint>
#include <deque>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "core/result.h"
#include "drivers/clock.h"

namespace lightrig::sim {

class World;

/// Which wire of the rig.
enum class Wire : std::uint8_t { gantry, lamp, camera };

/// What goes wrong at the far end of a wire [docs/simulate.md].
enum class WireEffect : std::uint8_t {
  // To one answer.
  silence,          ///< the request is neither obeyed nor answered
  lost_answer,      ///< obeyed, but the answer is lost
  exception,        ///< a Modbus exception (`code`) or GRBL error; not obeyed
  late,             ///< obeyed, answered `ms` later
  duplicate,        ///< answered twice
  wrong_id,         ///< answered under another transaction or unit number
  truncated,        ///< half of the answer
  corrupted,        ///< one bit of the answer is turned
  short_reads,      ///< the answer comes a byte at a time
  garbled_request,  ///< GRBL: a digit of the command is lost; what is left is obeyed
  // To the wire.
  closed,     ///< obeyed, then the connection is closed without an answer
  half_open,  ///< nothing more is heard on this connection; a new one works
  unplug,     ///< the device is gone for `ms`
  stall,      ///< USB: the bulk endpoint answers STALL
  nak,        ///< USB: takes and gives nothing for `ms`
  // To the drives.
  alarm,         ///< drive alarm, `code`
  limit,         ///< a limit switch is met
  jam,           ///< the drives halt short of their target and say nothing
  slip,          ///< an axis jumps by `degrees`
  door,          ///< the rig's first interlock is open for `ms` (0: stays open)
  e_stop,        ///< the emergency stop chain is open for `ms` (0: stays open)
  watchdog,      ///< the drive's communication watchdog trips
  reboot,        ///< the controller restarts: silent for `ms`, home lost, settings as at power-on
  lamp_failure,  ///< the lamp goes dark by itself
};
std::string_view name_of(WireEffect effect);
std::optional<WireEffect> wire_effect(std::string_view name);

/// When and how something goes wrong once.
struct WireFault {
  WireEffect effect = WireEffect::silence;
  Wire wire = Wire::gantry;
  /// What sets it off; the first that is given, else at once. Counted from when it was added.
  std::optional<std::uint64_t> request;  ///< the n-th request on its wire
  std::optional<std::uint64_t> motion;   ///< the n-th time the drives begin to move
  std::optional<std::uint64_t> lit;      ///< the n-th time the lamp goes on
  std::optional<double> time;            ///< [s]
  std::chrono::milliseconds delay{0};    ///< after that
  int count = 1;                         ///< answers in a row
  std::optional<int> unit;               ///< Modbus: only answers of this unit
  std::chrono::milliseconds duration{500};
  int code = 0;        ///< of an exception (4 where 0) or an alarm
  std::string axis;    ///< for slip; "" the first
  double degrees = 1;  ///< for slip; millimetres on a linear axis
};

/// One fault as text: "EFFECT [wire=gantry|lamp|camera] [request=N | motion=N | lit=N | time=S]
/// [delay_ms=N] [count=N] [unit=N] [ms=N] [code=N] [axis=NAME] [degrees=X]". Errors:
/// invalid_input, with what would be right.
Result<WireFault> parse_wire_fault(std::string_view line);
/// The faults of a simulated rig, scripted before and added at run time, shared by the far ends of
/// all its wires. Safe to call from several threads.
class WireFaults {
 public:
  explicit WireFaults(std::shared_ptr<World> world);

  /// Errors: invalid_input when the rig has no such axis or interlock.
  Result<void> add(WireFault fault);

  /// Counts a request on a wire, to a unit where there are several, lets time pass, and says what
  /// becomes of its answer.
  std::optional<WireFault> on_request(Wire wire, int unit = 0);
  /// Lets time pass: what is due to the drives happens; what is due to the wire itself (closed,
  /// unplug, reboot, …) comes back, for the far end to carry out.
  std::optional<WireFault> tick(Wire wire);

  /// What has struck so far, in order: "silence on the gantry's wire at request 41".
  std::vector<std::string> struck() const;
  std::uint64_t requests(Wire wire) const;

 private:
  struct Waiting {
    WireFault fault;
    std::uint64_t request = 0, motion = 0, lit = 0;  ///< absolute; 0 = not by this
    TimePoint time;
    bool due = false;
    int left = 1;
    bool said = false;
  };
  void look();
  void strike(const WireFault& fault);
  void say(Waiting& waiting);
  std::optional<WireFault> take(Wire wire, bool answer, int unit);

  std::shared_ptr<World> world_;
  mutable std::mutex mutex_;
  std::deque<Waiting> waiting_;
  std::deque<std::pair<TimePoint, std::string>> closing_;  ///< interlocks that close again
  std::vector<std::string> struck_;
  std::array<std::uint64_t, 3> requests_{};
  std::uint64_t motions_ = 0, lit_ = 0;
  bool was_moving_ = false, was_lit_ = false;
};

}  // namespace lightrig::sim
