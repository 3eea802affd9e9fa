// A backend that a build leaves out answers every call of its header, and says how to get it.
#include <gtest/gtest.h>

#include "config/rig.h"
#include "drivers/backends.h"

namespace lightrig {
namespace {

struct Answer {
  Backend backend;
  std::string option;
  Error error;
};

std::vector<Answer> answers() {
  RealClock clock;
  const Rig rig;
  ModbusLamp lamp;
  lamp.endpoint = TcpEndpoint{"127.0.0.1", 1};
  lamp.coil = 0;
  GrblGantry grbl;
  SerialEndpoint nowhere;
  nowhere.device = "/dev/lightrig-none";
  grbl.endpoint = nowhere;
  const auto modbus = open_lamp(rig, lamp, clock);
  const auto usb = open_gantry(rig, grbl, clock);
  std::vector<Answer> out;
  out.push_back({modbus_backend(), "LIGHTRIG_WITH_MODBUS", modbus ? Error{} : modbus.error()});
  out.push_back({usb_backend(), "LIGHTRIG_WITH_USB", usb ? Error{} : usb.error()});
  const auto usb_lamp = open_lamp(rig, GrblLamp{nowhere, "flood"}, clock);
  out.push_back({usb_backend(), "LIGHTRIG_WITH_USB", usb_lamp ? Error{} : usb_lamp.error()});
  return out;
}

TEST(Twin, ALeftOutBackendSaysSoAndHowToGetIt) {
  for (const Answer& answer : answers()) {
    if (answer.backend.built) {
      EXPECT_TRUE(answer.backend.remedy.empty());
      EXPECT_NE(answer.error.code, ErrorCode::not_built) << answer.error.message;
      EXPECT_FALSE(answer.error.message.empty()) << "nothing listens there";
      continue;
    }
    EXPECT_EQ(answer.error.code, ErrorCode::not_built);
    EXPECT_NE(answer.error.message.find(answer.option + "=ON"), std::string::npos)
        << answer.error.message;
    EXPECT_NE(answer.backend.remedy.find("install"), std::string::npos) << answer.backend.remedy;
  }
}

TEST(Twin, ARigOfWhichAPartIsLeftOutIsNotOpenedHalf) {
  RealClock clock;
  Rig rig;
  SerialEndpoint nowhere;
  nowhere.device = "/dev/lightrig-none";
  GrblGantry grbl;
  grbl.endpoint = nowhere;
  rig.gantry.backend = grbl;
  rig.camera.backend = AravisCamera{};
  const auto devices = open_devices(rig, clock);
  ASSERT_FALSE(devices);
  const Backend missing = !usb_backend().built ? usb_backend() : aravis_backend();
  if (missing.built) {
    EXPECT_NE(devices.error().code, ErrorCode::not_built) << "the port is not there";
    return;
  }
  // Although the gantry, which comes first, is not there either.
  EXPECT_EQ(devices.error().code, ErrorCode::not_built) << devices.error().message;
  EXPECT_NE(devices.error().message.find(missing.remedy), std::string::npos)
      << devices.error().message;
}

TEST(Twin, EveryBackendIsNamedOnce) {
  const std::vector<Backend> all = backends();
  ASSERT_EQ(all.size(), 3U);
  EXPECT_EQ(all[0].name, "modbus");
  EXPECT_EQ(all[1].name, "usb");
  EXPECT_EQ(all[2].name, "aravis");
}

TEST(Twin, ARigWithoutHardwareIsRefusedOutsideSimulation) {
  RealClock clock;
  const auto devices = open_devices(Rig{}, clock);
  ASSERT_FALSE(devices);
  EXPECT_EQ(devices.error().code, ErrorCode::refused);
  EXPECT_NE(devices.error().message.find("--simulate"), std::string::npos)
      << devices.error().message;
}

}  // namespace
}  // namespace lightrig
