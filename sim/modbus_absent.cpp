// The twin of modbus/ for builds with LIGHTRIG_WITH_MODBUS=OFF.
#include "sim/hosted_wire.h"

namespace lightrig::sim {

namespace {

constexpr const char* remedy =
    "this build leaves it out: install libmodbus-dev and build with -DLIGHTRIG_WITH_MODBUS=ON";

}  // namespace

Result<std::vector<HostedWire>> host_wire(const Rig&, const ModbusGantry&, std::shared_ptr<World>,
                                          std::shared_ptr<WireFaults>) {
  return fail(ErrorCode::not_built, std::string("simulated Modbus wire: ") + remedy);
}

Result<std::vector<HostedWire>> host_wire(const Rig&, const ModbusLamp&, std::shared_ptr<World>,
                                          std::shared_ptr<WireFaults>) {
  return fail(ErrorCode::not_built, std::string("simulated Modbus lamp: ") + remedy);
}

}  // namespace lightrig::sim
