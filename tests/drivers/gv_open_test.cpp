// What our camera driver does before the first frame: settings written and read back, the network
// looked at, and what it says when something is wrong.
#include <gtest/gtest.h>
#include <linux/capability.h>
#include <sys/mount.h>
#include <sys/prctl.h>
#include <sys/syscall.h>

#include <filesystem>

#include "tests/drivers/gv_camera_rig.h"

namespace lightrig {
namespace {

class GvOpen : public test::GvCameraTest {
 protected:
  void expect_failure(ErrorCode code, std::initializer_list<const char*> words) {
    const auto camera = open();
    ASSERT_FALSE(camera);
    EXPECT_EQ(camera.error().code, code) << camera.error().message;
    for (const char* word : words)
      EXPECT_NE(camera.error().message.find(word), std::string::npos)
          << word << " in: " << camera.error().message;
  }
};

TEST_F(GvOpen, AnyFeatureOfTheRigFileIsWrittenAndReadBack) {
  backend().features = {{"Gain", "6.5"}, {"AcquisitionFrameRate", "20"}, {"GevSCPD", "1000"}};
  {
    const auto camera = open();
    ASSERT_TRUE(camera) << camera.error().message;
    const auto frame = (*camera)->expose(0.01, soon(5));
    EXPECT_TRUE(frame) << frame.error().message;
  }
  backend().features = {{"Gain", "48"}};
  expect_failure(ErrorCode::refused, {"Gain", "48"});
  backend().features = {{"Flavour", "strong"}};
  expect_failure(ErrorCode::not_found, {"Flavour", "arv-tool"});
  backend().features = {{"PixelFormat", "RGB8"}};
  expect_failure(ErrorCode::refused, {"PixelFormat", "RGB8"});
}

TEST_F(GvOpen, APixelFormatOfAnotherDepthThanTheSensorsIsRefused) {
  backend().pixel_format = "Mono16";
  expect_failure(ErrorCode::invalid_input, {"Mono16", "12 bits"});
  backend().pixel_format = "BayerRG12";
  expect_failure(ErrorCode::invalid_input, {"BayerRG12", "filter"});
}

TEST_F(GvOpen, ExposuresThatTheCameraCannotTakeAreRefusedAtOpening) {
  rig_.camera.sensor.max_exposure = 100;
  expect_failure(ErrorCode::invalid_input, {"100 s", "0.0001 … 2 s"});
}

TEST_F(GvOpen, AReceiveBufferThatTheKernelWouldCutIsRefusedWithTheCommand) {
  backend().socket_buffer_bytes = test::receive_ceiling() + 4096;
  expect_failure(ErrorCode::refused, {"sysctl -w net.core.rmem_max="});
}

// As in a service whose unit says ProcSubset=pid.
TEST_F(GvOpen, TheKernelsCutIsSeenWhereProcSysIsHidden) {
  ASSERT_EQ(unshare(CLONE_NEWNS), 0) << std::strerror(errno);
  ASSERT_EQ(mount(nullptr, "/", nullptr, MS_REC | MS_PRIVATE, nullptr), 0) << std::strerror(errno);
  ASSERT_EQ(mount("none", "/proc/sys", "tmpfs", 0, nullptr), 0) << std::strerror(errno);
  ASSERT_FALSE(std::filesystem::exists("/proc/sys/net"));
  backend().socket_buffer_bytes = test::receive_ceiling() + 4096;
  expect_failure(ErrorCode::refused, {"sysctl -w net.core.rmem_max="});
  EXPECT_EQ(umount("/proc/sys"), 0);
}

// A curve between light and counts would be taken for the material's.
TEST_F(GvOpen, GammaIsSwitchedOffAndACameraThatKeepsItOnIsRefused) {
  backend().features = {{"GammaEnable", "true"}};
  {
    const auto camera = open();
    EXPECT_TRUE(camera) << camera.error().message;
  }
  faults_->hold_gamma();
  expect_failure(ErrorCode::refused, {"GammaEnable was switched off, but the camera says"});
}

TEST_F(GvOpen, APacketSizeThatTheNetworkDoesNotCarryIsRefusedWithTheCommand) {
  const int control = socket(AF_INET, SOCK_DGRAM, 0);
  ifreq request{};
  std::strncpy(request.ifr_name, "lo", IFNAMSIZ - 1);
  request.ifr_mtu = 1500;
  ASSERT_EQ(ioctl(control, SIOCSIFMTU, &request), 0);
  close(control);
  backend().packet_size = 8000;
  expect_failure(ErrorCode::refused, {"8000", "1500 bytes", "mtu 9000"});
  backend().packet_size = 0;  // negotiated
  const auto camera = open();
  ASSERT_TRUE(camera) << camera.error().message;
  EXPECT_TRUE((*camera)->expose(0.01, soon(5)));
}

TEST_F(GvOpen, APacketSocketReceivesWhereItIsAllowedAndIsRefusedWhereNot) {
  backend().packet_socket = true;
  {
    const auto camera = open();
    ASSERT_TRUE(camera) << camera.error().message;
    const auto frame = (*camera)->expose(0.01, soon(5));
    EXPECT_TRUE(frame) << frame.error().message;
  }
  __user_cap_header_struct header{_LINUX_CAPABILITY_VERSION_3, 0};
  std::array<__user_cap_data_struct, 2> capabilities{};
  ASSERT_EQ(syscall(SYS_capget, &header, capabilities.data()), 0);
  capabilities[0].effective &= ~(1U << CAP_NET_RAW);
  ASSERT_EQ(syscall(SYS_capset, &header, capabilities.data()), 0);
  expect_failure(ErrorCode::refused, {"CAP_NET_RAW", "packet_socket = false"});
}

TEST_F(GvOpen, ACameraIsReachedThroughTheNetworkThatTheRigFileNames) {
  backend().interface_ip = "127.0.0.1";
  for (const char* id : {"127.0.0.1", "SIM1"}) {
    backend().id = id;
    const auto camera = open();
    ASSERT_TRUE(camera) << id << ": " << camera.error().message;
    EXPECT_TRUE((*camera)->expose(0.01, soon(5)));
  }
  backend().interface_ip = "here";
  expect_failure(ErrorCode::invalid_input, {"interface_ip", "here"});
  backend().interface_ip = "";
  backend().port = 4000;
  expect_failure(ErrorCode::invalid_input, {"4000", "3956"});
}

TEST_F(GvOpen, AnUnknownSerialNumberIsAnsweredWithTheCamerasThatAreThere) {
  backend().id = "GX-4711";
  expect_failure(ErrorCode::not_found, {"GX-4711", "lightrig-Simulated-SIM1 at 127.0.0.1"});
}

TEST_F(GvOpen, CamerasAreListedWithoutTakingControlOfAny) {
  const auto held = open();
  ASSERT_TRUE(held) << held.error().message;
  const auto found = find_cameras();
  ASSERT_TRUE(found) << found.error().message;
  ASSERT_EQ(found->size(), 1U);
  EXPECT_EQ(found->front().id, "lightrig-Simulated-SIM1");
  EXPECT_EQ(found->front().address, "127.0.0.1");
  EXPECT_EQ(found->front().serial, "SIM1");
  EXPECT_EQ(found->front().obstacle.find("sysctl") != std::string::npos,
            test::receive_ceiling() < AravisCamera{}.socket_buffer_bytes);
  EXPECT_TRUE((*held)->expose(0.01, soon(5)));
}

TEST_F(GvOpen, ACameraThatNumbersItsFramesAnewFromEveryStartStillGivesEveryFrame) {
  faults_->number_anew_from_every_start();
  const auto camera = open();
  ASSERT_TRUE(camera) << camera.error().message;
  std::uint64_t last = 0;
  for (int i = 0; i < 4; ++i) {
    const auto frame = (*camera)->expose(0.01, soon(5));
    ASSERT_TRUE(frame) << frame.error().message;
    EXPECT_GT(frame->id, last);
    last = frame->id;
  }
  EXPECT_EQ((*camera)->counters().rejected, 0U);
}

}  // namespace
}  // namespace lightrig
