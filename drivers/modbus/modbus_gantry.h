#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "config/rig.h"
#include "drivers/devices.h"
#include "drivers/modbus/modbus_bus.h"
#include "drivers/modbus/modbus_drive.h"

namespace lightrig {

/// The wires and drives, shared by the gantry and the lamp on its outputs, both used by the session
/// thread alone.
struct ModbusController {
  ControllerProfile profile;
  std::map<std::string, std::unique_ptr<ModbusBus>>
      buses;                              // one per wire, however many drives are on it
  std::vector<ModbusDriveDevice> drives;  // in axis order
};

/// Drives that move together. Needs the controller's drives only once it is asked for something, or
/// destroyed: then it stops those that are there.
class ModbusGantryDevice final : public Gantry {
 public:
  ModbusGantryDevice(const Rig& rig, Clock& clock, std::shared_ptr<ModbusController> controller)
      : model_(rig.gantry.model),
        interlocks_(rig.interlocks),
        clock_(clock),
        controller_(std::move(controller)) {}
  ~ModbusGantryDevice() override { tell_to_stop(); }

  Result<void> home(const Until& until) override;
  Result<void> move_to(const GantryPosition& position, const Until& until) override;
  Result<GantryStatus> status(const Until& until) override;
  Result<void> clear_fault(const Until& until) override;

 private:
  enum class Motion : std::uint8_t {
    unknown,  ///< nobody looked yet: a program that died may have left the drives moving
    started,  ///< by us, and its end not yet seen
    none,
  };
  /// What one look at all drives shows: the status, and what only moves need to know.
  struct Look {
    GantryStatus status;
    bool in_position = true;  ///< every drive says so, as far as it has the bit
    std::string not_ready;    ///< the first drive that could not move now, and why; "" when none
  };
  Result<Look> look(const Until& until);
  Result<void> wait_until_ready(const Until& until);
  std::vector<DriveMove> coordinated(const GantryPosition& from, const GantryPosition& to) const;
  Result<void> start(const ProfileCommand& command, const std::vector<DriveMove>& moves,
                     const Until& until);
  Result<void> wait_for_arrival(const GantryPosition& before, const GantryPosition* target,
                                const Until& until);
  Result<std::vector<std::string>> open_interlocks(const Until& until);
  std::string where(const Look& seen, const GantryPosition* target) const;
  Result<void> require_able_to_move(const GantryStatus& status) const;
  void tell_to_stop();
  void tell_to_stop(const std::vector<ModbusDriveDevice*>& drives) const;

  const GantryModel model_;
  const std::vector<Interlock> interlocks_;
  Clock& clock_;
  std::shared_ptr<ModbusController> controller_;
  bool homed_ = false;  ///< for drives whose profile has no homed bit
  Motion motion_ = Motion::unknown;
};

}  // namespace lightrig
