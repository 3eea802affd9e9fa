#pragma once

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

/// What a move asks of one drive.
struct DriveMove {
  double position = 0;      ///< [rad] or [m]
  double speed = 0;         ///< [rad/s] or [m/s]
  double acceleration = 0;  ///< [rad/s²] or [m/s²]
};

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
  Result<void> run(const ProfileCommand& command, const DriveMove& move, const Until& until);
  /// The same in two parts: until the trigger is set, and its clearing after the pulse.
  Result<void> begin(const ProfileCommand& command, const DriveMove& move, const Until& until);
  Result<void> end(const ProfileCommand& command, const Until& until);
  Result<DriveStatus> status(const Until& until);
  /// These bits, in their order.
  Result<std::vector<bool>> bits(const std::vector<StatusBit>& wanted, const Until& until);
  Result<void> set_output(const ProfileOutput& output, double power, const Until& until);
  Result<double> read_output(const ProfileOutput& output, const Until& until);

  const ControllerProfile& profile() const { return profile_; }
  const std::string& axis() const { return config_.axis; }

 private:
  using Seen = std::map<std::pair<RegisterTable, int>, std::uint16_t>;
  Result<Seen> read_all(const std::vector<RegisterSpan>& spans, const Until& until);
  Result<std::string> alarm_of(const Until& until);
  double value_of(const ProfileWrite& write, const DriveMove& move) const;
  Result<void> write_block(const ProfileCommand& command, const DriveMove& move,
                           const Until& until);
  Result<void> put(const Trigger& trigger, std::int64_t value, const Until& until);
  void keep_gap(const Until& until);

  const ControllerProfile& profile_;
  const ModbusDrive config_;
  ModbusBus& bus_;
  Clock& clock_;
};

}  // namespace lightrig
