#pragma once

#include <map>
#include <memory>
#include <string>
#include <vector>

#include "config/rig.h"
#include "drivers/devices.h"
#include "drivers/usb/grbl_link.h"

namespace lightrig {

/// One controller, shared by the gantry and the lamp that hangs on it; both are used by the session
/// thread alone. (Shared ownership is the truth here: whichever goes last closes the wire.)
struct GrblController {
  GrblLink link;
  std::map<int, double> settings;
};

class GrblGantryDevice final : public Gantry {
 public:
  GrblGantryDevice(const Rig& rig, const GrblGantry& backend, Clock& clock,
                   std::shared_ptr<GrblController> controller);
  ~GrblGantryDevice() override;

  Result<void> home(const Until& until) override;
  Result<void> move_to(const GantryPosition& position, const Until& until) override;
  Result<GantryStatus> status(const Until& until) override;
  Result<void> clear_fault(const Until& until) override;

 private:
  Result<void> wait_for_arrival(const GantryPosition& from, const GantryPosition& target,
                                const Until& until);
  bool leaves_way(const GantryPosition& from, const GantryPosition& to,
                  const GantryPosition& here) const;
  Result<void> settle_stop(const Until& until);
  std::string move_command(const GantryPosition& from, const GantryPosition& to) const;
  GantryPosition position_of(const grbl::StatusReport& report) const;
  void tell_to_stop();

  const GantryModel model_;
  const GrblGantry backend_;
  const std::vector<Interlock> interlocks_;
  Clock& clock_;
  std::shared_ptr<GrblController> controller_;
  AxisValues zero_;  ///< axis value where the machine position is 0
  bool homed_ = false;
  bool stop_pending_ = false;  ///< a feed hold was sent; a reset must follow once at rest
};

/// The lamp on a spindle or coolant output of the gantry's controller, or of one of its own.
class GrblLampDevice final : public Lamp {
 public:
  GrblLampDevice(std::string output, double most, Clock& clock,
                 std::shared_ptr<GrblController> controller)
      : output_(std::move(output)),
        most_(most),
        clock_(clock),
        controller_(std::move(controller)) {}
  ~GrblLampDevice() override;
  Result<void> set(double power, const Until& until) override;
  Result<LampState> state(const Until& until) override;

 private:
  std::string command_for(double power) const;
  Result<void> check_spindle(double power, const Until& until);

  const std::string output_;
  const double most_;
  Clock& clock_;
  std::shared_ptr<GrblController> controller_;
  double power_ = 0;
};

}  // namespace lightrig
