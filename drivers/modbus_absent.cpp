// The twin of modbus/ for builds with LIGHTRIG_WITH_MODBUS=OFF.
#include "drivers/backends.h"

namespace lightrig {
namespace {

constexpr const char* remedy =
    "this build leaves it out: install libmodbus-dev and build with -DLIGHTRIG_WITH_MODBUS=ON";

}  // namespace

Result<GantryAndLamp> open_gantry(const Rig&, const ModbusGantry&, Clock&) {
  return fail(ErrorCode::not_built, std::string("Modbus gantry: ") + remedy);
}

Result<GantryAndLamp> open_gantry(const Rig&, const FixedLampsGantry&, Clock&) {
  return fail(ErrorCode::not_built, std::string("fixed lamps on Modbus coils: ") + remedy);
}

Result<std::unique_ptr<Lamp>> open_lamp(const Rig&, const ModbusLamp&, Clock&) {
  return fail(ErrorCode::not_built, std::string("Modbus lamp: ") + remedy);
}

Backend modbus_backend() { return {"modbus", false, remedy}; }

}  // namespace lightrig
