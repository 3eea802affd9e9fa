// The contract of every gantry and lamp, kept over wires against simulated controllers: Modbus TCP
// with a lamp of its own, Modbus RTU with the lamp on the drives' line, GRBL on a tty and on USB, a
// lamp on a GRBL controller of its own on either.
// The camera beside them is the laboratory's own; over its wire it is in gv_contract_test.cpp.
// Each wire is one ctest entry (tests/CMakeLists.txt).
#include <unistd.h>

#include <cstdlib>
#include <variant>

#include "sim/memory_devices.h"
#include "tests/drivers/contract.h"
#include "tests/drivers/own_network.h"
#include "tests/drivers/wire_rig.h"

namespace lightrig {
namespace {

using namespace std::chrono_literals;

constexpr double degrees_per_rad = 57.29577951308232;

/// What lives at the far end.
struct FarEnd {
  std::shared_ptr<Clock> clock;
  std::shared_ptr<sim::World> world;
  std::vector<sim::HostedWire> wires;
};

std::string pty_path(const char* name) {
  return testing::TempDir() + "lightrig_contract_" + name + "_" + std::to_string(getpid());
}

Rig contract_rig() {
  Rig rig = test::quick_rig();
  CameraModel& camera = rig.camera.model;  // the whole object in its few pixels
  camera.fx = camera.fy = 170;
  camera.cx = 15.5;
  camera.cy = 11.5;
  for (Axis& axis : rig.gantry.model.axes) {
    axis.max_speed = 4;
    axis.max_acceleration = 20;
  }
  return rig;
}

template <class Backend>
void host(FarEnd& far_end, const Rig& rig, const Backend& backend) {
  auto hosted = sim::host_wire(rig, backend, far_end.world);
  ASSERT_TRUE(hosted) << hosted.error().message;
  for (sim::HostedWire& wire : *hosted) far_end.wires.push_back(std::move(wire));
}

/// Opens gantry and lamp over wires; a lamp that is not the gantry's own has its own wire.
template <class Backend>
ContractSubject open_over(Rig rig, const Backend& backend) {
  ContractSubject subject;
  rig.gantry.backend = backend;
  subject.rig = rig;
  auto far_end = std::make_shared<FarEnd>();
  far_end->clock = std::make_shared<RealClock>();
  far_end->world = test::world_of(rig, *far_end->clock);
  host(*far_end, rig, backend);
  const auto* own_lamp = std::get_if<ModbusLamp>(&rig.lamp.backend);
  if (own_lamp) host(*far_end, rig, *own_lamp);
  subject.clock = far_end->clock;
  auto opened = open_gantry(rig, backend, *subject.clock);
  EXPECT_TRUE(opened) << opened.error().message;
  if (!opened) return subject;
  subject.devices.gantry = std::move(opened->gantry);
  subject.devices.lamp = std::move(opened->lamp);
  if (!subject.devices.lamp) {
    auto lamp = open_lamp(rig, *own_lamp, *subject.clock);
    EXPECT_TRUE(lamp) << lamp.error().message;
    subject.devices.lamp = std::move(*lamp);
  }
  subject.devices.camera = sim::make_camera(far_end->world);
  const sim::World* world = far_end->world.get();
  subject.lamp_power_at_far_end = [world] { return world->lamp_power(); };
  subject.moving_at_far_end = [world] { return !world->gantry_status().at_rest; };
  subject.keep_alive = far_end;
  return subject;
}

// Where no network of its own can be had the host's loopback must do.
ContractSubject open_tcp() {
  static_cast<void>(test::enter_own_network());
  Rig rig = contract_rig();
  auto backend = std::get<ModbusGantry>(rig.gantry.backend);
  for (ModbusDrive& drive : backend.drives) drive.endpoint = TcpEndpoint{"127.0.0.1", 1502};
  ModbusLamp lamp;
  lamp.endpoint = TcpEndpoint{"127.0.0.1", 1503};
  lamp.holding = 7;
  lamp.full_scale = 1000;
  rig.lamp.backend = lamp;
  return open_over(std::move(rig), backend);
}

ContractSubject open_rtu() {
  Rig rig = contract_rig();
  auto backend = std::get<ModbusGantry>(rig.gantry.backend);
  backend.timeout = 300ms;
  backend.controller.moving.reset();  // these drives say only whether they are in position
  backend.controller.done.must_see_busy = false;
  SerialEndpoint serial;
  serial.device = pty_path("rtu");
  for (ModbusDrive& drive : backend.drives) drive.endpoint = serial;
  ModbusLamp lamp;
  lamp.endpoint = serial;
  lamp.unit = 9;
  lamp.coil = 3;
  rig.lamp.max_power = rig.lamp.power = 1;  // a coil dims nothing
  rig.lamp.backend = lamp;
  return open_over(std::move(rig), backend);
}

// A GRBL controller takes no lamp command before it is homed.
ContractSubject open_grbl(const std::variant<UsbEndpoint, SerialEndpoint>& endpoint) {
  Rig rig = contract_rig();
  GrblGantry backend;
  backend.letters = {'X', 'Y'};
  backend.units_per_si = {degrees_per_rad, degrees_per_rad};
  backend.endpoint = endpoint;
  rig.lamp.backend = GantryLamp{"spindle"};
  ContractSubject subject = open_over(std::move(rig), backend);
  const auto homed = subject.devices.gantry->home({subject.clock->now() + 30s, {}});
  EXPECT_TRUE(homed) << homed.error().message;
  return subject;
}

ContractSubject open_grbl_tty() {
  SerialEndpoint serial;
  serial.device = pty_path("grbl");
  return open_grbl(serial);
}

ContractSubject open_grbl_usb() { return open_grbl(UsbEndpoint{0x1209, 1, "CONTRACT", 115200}); }

// A lamp on a GRBL controller of its own; the gantry beside it is the laboratory's own.
ContractSubject open_grbl_lamp(const GrblEndpoint& endpoint) {
  ContractSubject subject;
  Rig rig = contract_rig();
  const GrblLamp backend{endpoint, "spindle"};
  rig.gantry.backend = SimulatedGantry{};
  rig.lamp.backend = backend;
  subject.rig = rig;
  auto far_end = std::make_shared<FarEnd>();
  far_end->clock = std::make_shared<RealClock>();
  far_end->world = test::world_of(rig, *far_end->clock);
  host(*far_end, rig, backend);
  subject.clock = far_end->clock;
  auto lamp = open_lamp(rig, backend, *subject.clock);
  EXPECT_TRUE(lamp) << lamp.error().message;
  if (!lamp) return subject;
  subject.devices.lamp = std::move(*lamp);
  subject.devices.gantry = sim::make_gantry(far_end->world);
  subject.devices.camera = sim::make_camera(far_end->world);
  const sim::World* world = far_end->world.get();
  subject.lamp_power_at_far_end = [world] { return world->lamp_power(); };
  subject.moving_at_far_end = [world] { return !world->gantry_status().at_rest; };
  subject.keep_alive = far_end;
  return subject;
}

ContractSubject open_grbl_lamp_tty() {
  SerialEndpoint serial;
  serial.device = pty_path("grbl_lamp");
  return open_grbl_lamp(serial);
}

ContractSubject open_grbl_lamp_usb() {
  return open_grbl_lamp(UsbEndpoint{0x1209, 2, "CONTRACT-LAMP", 115200});
}

// Only where the backend is built; the twins' tests say what is said where it is not.
std::vector<ContractBackend> wires() {
  std::vector<ContractBackend> all;
  if (backends()[0].built) {
    all.push_back({"ModbusTcp", open_tcp});
    all.push_back({"ModbusRtu", open_rtu});
  }
  if (!backends()[1].built) return all;
  all.push_back({"GrblTty", open_grbl_tty});
  all.push_back({"GrblLampTty", open_grbl_lamp_tty});
  // Seen only under umockdev, with which its ctest entry starts it.
  const char* loaded = std::getenv("LD_PRELOAD");
  if (loaded != nullptr && std::string(loaded).find("umockdev") != std::string::npos)
    all.insert(all.end(), {{"GrblUsb", open_grbl_usb}, {"GrblLampUsb", open_grbl_lamp_usb}});
  return all;
}

}  // namespace

GTEST_ALLOW_UNINSTANTIATED_PARAMETERIZED_TEST(DeviceContract);
GTEST_ALLOW_UNINSTANTIATED_PARAMETERIZED_TEST(DeviceContractInTime);
INSTANTIATE_TEST_SUITE_P(Wires, DeviceContract, testing::ValuesIn(wires()),
                         [](const auto& backend) { return backend.param.name; });
INSTANTIATE_TEST_SUITE_P(Wires, DeviceContractInTime, testing::ValuesIn(wires()),
                         [](const auto& backend) { return backend.param.name; });

}  // namespace lightrig
