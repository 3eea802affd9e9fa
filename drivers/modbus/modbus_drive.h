#pragma once

#include <cmath>
#include <cstdint>
#include <functional>
#include <map>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "config/controller_profile.h"
#include "config/rig.h"
#include "drivers/modbus/modbus_bus.h"

namespace lightrig {

/// Registers of a raw number, and back. raw = value · scale + offset, rounded. Errors:
/// invalid_input when it does not fit.
Result<std::vector<std::uint16_t>> encode_raw(const RegisterItem& item, double raw);
Result<std::vector<std::uint16_t>> encode(const RegisterItem& item, double value);
std::int64_t decode_raw(const RegisterItem& item, const std::vector<std::uint16_t>& registers);
double decode(const RegisterItem& item, const std::vector<std::uint16_t>& registers);

/// Registers, or bits, in a row.
struct RegisterSpan {
  RegisterTable table = RegisterTable::holding;
  int address = 0, count = 1;
};

/// What covers these and nothing else by the fewest requests: a request costs a round trip, and
/// what comes in one answer is of one moment. What does not touch is not joined: a drive may refuse
/// to read the registers between.
std::vector<RegisterSpan> joined(std::vector<RegisterSpan> spans);

/// Words for registers in a row.
struct RegisterWrite {
  RegisterTable table = RegisterTable::holding;
  int address = 0;
  std::vector<std::uint16_t> words;
  bool multiple = false;  ///< by FC15/FC16 although it is one
};

/// What a move asks of one drive.
struct DriveMove {
  double position = 0;      ///< [rad] or [m]
  double speed = 0;         ///< [rad/s] or [m/s]
  double acceleration = 0;  ///< [rad/s²] or [m/s²]
};

/// The words that a command writes before its trigger, block by block. A speed or acceleration is
/// at least one of the register's units and at most what it holds: 0 would be no move, and a slow
/// axis beside a fast one may need less than a register can say. Errors: invalid_input where a
/// position does not fit.
Result<std::vector<RegisterWrite>> composed(const ModbusDrive& config,
                                            const ProfileCommand& command, const DriveMove& move);

/// Whether the drive's registers can hold the limits of its axis [rad/s, rad/s² or m/s, m/s²]: what
/// is less than one unit of them could only be exceeded. Errors: invalid_input.
Result<void> can_hold_limits(const ModbusDrive& config, const ProfileCommand& move,
                             double max_speed, double max_acceleration);

/// What a drive says of itself, in one look; what its profile has no bit for is as it stands here.
struct DriveStatus {
  double position = 0;  ///< [rad] or [m]
  bool moving = false;  ///< where the profile has no bit for it: not in position
  bool in_position = true, ready = true, enabled = true;
  bool homed = false, has_homed_bit = false, e_stop = false;
  std::string alarm;
};

/// One drive on a bus, as its controller profile describes it. One attempt per call.
class ModbusDriveDevice {
 public:
  ModbusDriveDevice(const ControllerProfile& profile, const ModbusDrive& config, ModbusBus& bus,
                    Clock& clock)
      : profile_(profile), config_(config), bus_(bus), clock_(clock) {}

  /// Proves that the profile fits (known register) and writes the drive's watchdog, then reads it
  /// back.
  Result<void> prepare(const Until& until);
  Result<void> run(const ProfileCommand& command, const Until& until);
  /// The same in two parts: until the trigger is set, and its clearing after the pulse.
  Result<void> begin(const ProfileCommand& command, const std::vector<RegisterWrite>& writes,
                     const Until& until, Delivery delivery = Delivery::in_step);
  Result<void> end(const ProfileCommand& command, const Until& until,
                   Delivery delivery = Delivery::in_step);
  Result<DriveStatus> status(const Until& until);
  /// These bits, in their order.
  Result<std::vector<bool>> bits(const std::vector<StatusBit>& wanted, const Until& until);
  /// Off goes out at once, whatever state the wire is in.
  Result<void> set_output(const ProfileOutput& output, double power, const Until& until);
  Result<double> read_output(const ProfileOutput& output, const Until& until);

  const ControllerProfile& profile() const { return profile_; }
  const ModbusDrive& config() const { return config_; }
  const std::string& axis() const { return config_.axis; }
  /// Of one count of the drive [rad] or [m].
  double resolution() const { return 1 / std::abs(config_.counts_per_si); }
  const ModbusBus* bus() const { return &bus_; }

 private:
  using Seen = std::map<std::pair<RegisterTable, int>, std::uint16_t>;
  Result<Seen> read_all(const std::vector<RegisterSpan>& spans, const Until& until);
  Result<std::string> alarm_of(const Until& until);
  Result<void> put(const Trigger& trigger, std::int64_t value, const Until& until,
                   Delivery delivery);

  const ControllerProfile& profile_;
  const ModbusDrive config_;
  ModbusBus& bus_;
  Clock& clock_;
};

}  // namespace lightrig
