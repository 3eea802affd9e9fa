#pragma once

#include <memory>

#include "config/rig.h"
#include "drivers/devices.h"
#include "drivers/modbus/modbus_bus.h"

namespace lightrig {

/// A lamp on a Modbus unit of its own, made dark at once. The bus may be shared with the gantry's
/// drives; both are used by the session thread alone. Errors: the bus'.
Result<std::unique_ptr<Lamp>> make_modbus_lamp(const Rig& rig, const ModbusLamp& config,
                                               Clock& clock, std::shared_ptr<ModbusBus> bus);

}  // namespace lightrig
