#pragma once

#include <chrono>
#include <cstdint>
#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "config/diagnostic.h"

namespace lightrig {

/// What a Modbus motion controller looks like from the wire: registers, moves, triggers, status.
/// A controller is data [docs/controller_profile.md]; drivers and the simulated far end read the
/// same description. Quantities are in the drive's own counts: what a count is worth on an axis is
/// said by the rig file (ModbusDrive).

/// Which of Modbus' four tables, and with it the function codes: coil 01/05/0F, discrete 02,
/// holding 03/06/10, input 04.
enum class RegisterTable : std::uint8_t { coil, discrete, holding, input };
/// 32-bit types take two registers, at address and address + 1.
enum class RawType : std::uint8_t { u16, s16, u32, s32 };
enum class WordOrder : std::uint8_t { high_first, low_first };

/// The unit that a register counts in.
enum class RawUnit : std::uint8_t {
  none,             ///< a plain number
  counts,           ///< position
  counts_per_s,     ///< speed
  rpm,              ///< speed of the motor; needs ModbusDrive::counts_per_rev
  counts_per_s2,    ///< acceleration
  ms_per_1000_rpm,  ///< acceleration as the time to gain 1000 rpm; needs counts_per_rev
};

/// Where and how a number is held: raw = value · scale + offset, rounded to the nearest integer.
struct RegisterItem {
  RegisterTable table = RegisterTable::holding;
  int address = 0;  ///< 0 … 65535, as on the wire (not 40001-based)
  RawType type = RawType::u16;
  WordOrder order = WordOrder::high_first;
  RawUnit unit = RawUnit::none;
  double scale = 1;  ///< raw per unit; negative turns the sense
  double offset = 0;

  int registers() const { return type == RawType::u32 || type == RawType::s32 ? 2 : 1; }
};

/// What a write carries.
enum class Quantity : std::uint8_t { constant, position, speed, acceleration, deceleration };
struct ProfileWrite {
  RegisterItem item;
  Quantity quantity = Quantity::constant;
  std::int64_t constant = 0;  ///< raw, when quantity is constant
};

/// How a command is set off.
enum class TriggerStyle : std::uint8_t {
  implicit,     ///< by the last of its writes; nothing more to do
  value,        ///< `set` is written and left
  level_clear,  ///< `set` is written, held for `pulse`, then `clear` is written
  edge,         ///< `clear`, then `set`, held for `pulse`, then `clear`: the rising edge acts
};
struct Trigger {
  TriggerStyle style = TriggerStyle::implicit;
  RegisterTable table = RegisterTable::holding;  ///< holding, or coil (set and clear are 0 or 1)
  int address = 0;
  std::int64_t set = 0, clear = 0;
  std::chrono::milliseconds pulse{0};
};

/// Writes in order, then a trigger.
struct ProfileCommand {
  bool block = false;  ///< all writes go out as one FC10 over consecutive holding registers
  std::vector<ProfileWrite> writes;
  Trigger trigger;
};

/// True when (register & mask) == value; a coil or discrete input counts as 0 or 1.
struct StatusBit {
  RegisterTable table = RegisterTable::holding;
  int address = 0;
  int mask = 0xffff, value = 0;
};

/// When a move is over. Always together with a position read back within tolerance, and no alarm:
/// - the drive no longer says moving, and says in position, as far as it has these bits; and
/// - with must_see_busy: moving was seen since the trigger, or `minimum_delay` has passed since
/// then
///   (a move too short to be caught moving);
/// - without: `minimum_delay` has passed since the trigger. So the previous move's done bit, still
///   standing, can never end this move.
struct DoneRule {
  bool must_see_busy = true;
  std::chrono::milliseconds minimum_delay{100};
};

/// The drive stops by itself when it hears nothing for so long.
struct DriveWatchdog {
  RegisterItem item;                     ///< written at opening and read back; value in seconds
  std::chrono::milliseconds timeout{0};  ///< what to write
};

/// An output of the controller, such as the lamp's.
struct ProfileOutput {
  RegisterTable table = RegisterTable::coil;  ///< coil, or holding
  int address = 0;
  int off = 0, on = 1;
  bool dimmable = false;  ///< values between off and on are powers between 0 and 1
};

/// Parameters of the serial line as the controller leaves its factory.
struct ProfileSerial {
  int baud = 115200;
  char parity = 'N';
  int data_bits = 8, stop_bits = 1;
};

/// Numbers that the controller accepts; a rig whose limits ask for more is refused.
struct ProfileLimits {
  std::optional<double> max_speed;                         ///< [counts/s]
  std::optional<std::int64_t> min_position, max_position;  ///< [counts]
};

struct ControllerProfile {
  std::string name;
  std::string source;      ///< manuals and code the registers were taken from
  std::string unverified;  ///< what nobody has yet seen on the hardware itself
  bool tcp = false, rtu = false;
  ProfileSerial serial;
  std::chrono::milliseconds frame_gap{0};  ///< silence between an answer and the next request
  int max_block = 123;                     ///< registers in one request

  ProfileCommand move, home, stop;
  /// Nothing here lets a motor go: an axis without a brake would fall.
  std::optional<ProfileCommand> enable, reset_alarm;

  RegisterItem position;  ///< unit: counts
  /// A register with a known answer, to prove a line in step after a late reply.
  struct Known {
    RegisterItem item;
    std::int64_t value = 0;
  };
  std::optional<Known> known;

  std::optional<StatusBit> ready, moving, in_position, homed, alarm, enabled, e_stop;
  DoneRule done;

  std::optional<RegisterItem> alarm_code;
  std::map<std::int64_t, std::string> alarm_texts;

  std::optional<DriveWatchdog> watchdog;
  ProfileLimits limits;
  std::map<std::string, ProfileOutput> outputs;
  std::map<std::string, StatusBit> inputs;  ///< true: closed, motion allowed
};

/// A profile with what was said about its file.
struct ReadProfile {
  std::optional<ControllerProfile> value;  ///< present iff there is no error
  std::vector<Diagnostic> diagnostics;
  std::string text;
};
ReadProfile read_profile(const std::filesystem::path& path);
ReadProfile read_profile_text(std::string text, const std::filesystem::path& path);

}  // namespace lightrig
