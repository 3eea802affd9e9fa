// The twin of modbus/ for builds with LIGHTRIG_WITH_MODBUS=OFF.
#include "sim/hosted_wire.h"

namespace lightrig::sim {

Result<std::vector<HostedWire>> host_wire(const Rig&, const ModbusGantry&, std::shared_ptr<World>) {
  return fail(
      ErrorCode::not_built,
      "simulated Modbus wire: this build leaves it out: install libmodbus-dev and build with "
      "-DLIGHTRIG_WITH_MODBUS=ON");
}

}  // namespace lightrig::sim
