#include "daemon/service/device_claims.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>

#include "tests/service/scratch_folder.h"

namespace lightrig {
namespace {

using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;

TEST(DeviceClaims, NameEveryWireOnceWhateverHangsOnIt) {
  const ScratchFolder folder;
  std::filesystem::create_symlink("/dev/null", folder.path() / "by-id");
  Rig rig;
  ModbusGantry gantry;
  gantry.drives.resize(2);
  gantry.drives[0].endpoint = TcpEndpoint{"Drives.lab", 502};
  gantry.drives[1].endpoint = TcpEndpoint{"drives.lab", 502};
  rig.gantry.backend = gantry;
  ModbusLamp lamp;
  SerialEndpoint serial;
  serial.device = (folder.path() / "by-id").string();
  lamp.endpoint = serial;
  rig.lamp.backend = lamp;
  AravisCamera camera;
  camera.id = "192.168.10.30";
  rig.camera.backend = camera;
  EXPECT_THAT(endpoints_of(rig),
              ElementsAre("camera 192.168.10.30", "modbus drives.lab:502", "serial /dev/null"));
  GrblGantry grbl;
  UsbEndpoint usb;
  usb.vendor = 0x1a86;
  usb.product = 0x7523;
  usb.serial = "A1";
  grbl.endpoint = usb;
  rig.gantry.backend = grbl;
  rig.lamp.backend = GantryLamp{};
  EXPECT_THAT(endpoints_of(rig), ElementsAre("camera 192.168.10.30", "usb 1a86:7523 A1"));
}

TEST(DeviceClaims, RefuseTheSameDeviceUnderAnotherFilesName) {
  Rig rig;
  AravisCamera camera;
  camera.id = "test-" + std::to_string(getpid());  // nobody else's
  rig.camera.backend = camera;
  rig.path = "/etc/lightrig/rig.toml";
  Rig copy = rig;
  copy.path = "/tmp/copy.toml";
  {
    const auto first = DeviceClaims::take(rig);
    ASSERT_TRUE(first) << first.error().message;
    const auto second = DeviceClaims::take(copy);
    ASSERT_FALSE(second);
    EXPECT_EQ(second.error().code, ErrorCode::refused);
    EXPECT_THAT(second.error().message,
                AllOf(HasSubstr("camera " + camera.id + " is in use by another lightrigd"),
                      HasSubstr("process " + std::to_string(getpid()))));
  }
  EXPECT_TRUE(DeviceClaims::take(copy)) << "what is gone holds nothing";
}

}  // namespace
}  // namespace lightrig
