#pragma once

#include <memory>
#include <string>
#include <variant>
#include <vector>

#include "config/rig.h"
#include "drivers/devices.h"

namespace lightrig {

/// A gantry and, where the rig's lamp hangs on the gantry's controller (GantryLamp, or a bank of
/// fixed lamps), the lamp that shares its wire.
struct GantryAndLamp {
  std::unique_ptr<Gantry> gantry;
  std::unique_ptr<Lamp> lamp;  ///< null where the rig's lamp is opened by itself
};

// One overload per backend of the variants in Rig: a forgotten backend does not compile. Each is
// defined in its own folder (modbus/, usb/, aravis/) or, where the option is OFF, in the twin
// (modbus_absent.cpp, …) that answers not_built.
Result<GantryAndLamp> open_gantry(const Rig& rig, const ModbusGantry& backend, Clock& clock);
Result<GantryAndLamp> open_gantry(const Rig& rig, const GrblGantry& backend, Clock& clock);
/// Gantry and lamp in one: fixed lamps on the coils of the rig's ModbusLamp.
Result<GantryAndLamp> open_gantry(const Rig& rig, const FixedLampsGantry& backend, Clock& clock);
Result<std::unique_ptr<Lamp>> open_lamp(const Rig& rig, const ModbusLamp& backend, Clock& clock);
Result<std::unique_ptr<Lamp>> open_lamp(const Rig& rig, const GrblLamp& backend, Clock& clock);
Result<std::unique_ptr<Camera>> open_camera(const Rig& rig, const AravisCamera& backend,
                                            Clock& clock);

/// What tells wires apart: one that has this name is open once at most, since a serial line has one
/// master.
std::string wire_of(const std::variant<TcpEndpoint, SerialEndpoint>& endpoint);

/// One line each for `lightrig backends`.
Backend modbus_backend();
Backend usb_backend();
Backend aravis_backend();

/// Names of the backends whose devices a rig file names.
std::vector<std::string> backends_named_by(const Rig& rig);
/// Names of the others, which opening the rig leaves alone; all of them where it is simulated.
std::vector<std::string> drivers_not_opened(const Rig& rig, bool simulated);

}  // namespace lightrig
