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

/// The part of a picture that a smaller rig file asks for.
RawImage cut_out(const RawImage& image, int x, int y, int width, int height) {
  RawImage part{width, height, {}};
  for (int row = y; row < y + height; ++row)
    for (int column = x; column < x + width; ++column)
      part.counts.push_back(
          image.counts[static_cast<std::size_t>(row) * static_cast<std::size_t>(image.width) +
                       static_cast<std::size_t>(column)]);
  return part;
}

// Whoever had the camera before may have left anything: what the rig file does not name is not
// theirs to choose, in a model with user sets or (the second time) in one without.
TEST_F(GvOpen, WhatSomebodyLeftInTheCameraIsUndone) {
  const int width = 40, height = 24, x = 13, y = 9;
  ASSERT_TRUE(world_->set_lamp(0.8));
  const auto whole = world_->expose(world_->look(), 0.05, {});
  ASSERT_TRUE(whole);
  rig_.camera.model.width = width;
  rig_.camera.model.height = height;
  for (const bool user_sets : {true, false}) {
    if (!user_sets) faults_->keep_settings();
    backend().features = {{"OffsetX", std::to_string(x)}, {"OffsetY", std::to_string(y)}};
    {
      const auto camera = open();
      ASSERT_TRUE(camera) << camera.error().message;
      const auto frame = (*camera)->expose(0.01, soon(5));
      ASSERT_TRUE(frame) << frame.error().message;
      const auto whole_then = world_->expose(world_->look(), 0.01, {});
      const RawImage ought = cut_out(whole_then->counts, x, y, width, height);
      // Other noise: bright where the other is bright, and nowhere else.
      for (std::size_t i = 0; i < ought.counts.size(); ++i)
        ASSERT_NEAR(frame->counts.counts[i], ought.counts[i], 0.3 * ought.counts[i] + 20) << i;
      EXPECT_NE((*camera)->identity().find("; Gain 0; BlackLevel 64"), std::string::npos)
          << (*camera)->identity();
    }
    backend().features.insert({{"ReverseX", "true"},
                               {"Gain", "12"},
                               {"BlackLevel", user_sets ? "300" : "64"},
                               {"TriggerSelector", "AcquisitionStart"},
                               {"GammaEnable", "true"}});
    {
      const auto camera = open();
      ASSERT_TRUE(camera) << camera.error().message;
    }
    const auto left = std::system(
        "arv-tool-0.8 -a 127.0.0.1 control "
        "TriggerSelector=AcquisitionStart TriggerMode=On >/dev/null");
    ASSERT_EQ(left, 0);
    backend().features.clear();
    const auto camera = open();
    ASSERT_TRUE(camera) << camera.error().message;
    const auto frame = (*camera)->expose(0.05, soon(5));
    ASSERT_TRUE(frame) << frame.error().message;
    const RawImage ought = cut_out(whole->counts, 0, 0, width, height);
    for (std::size_t i = 0; i < ought.counts.size(); ++i)
      ASSERT_NEAR(frame->counts.counts[i], ought.counts[i], 0.3 * ought.counts[i] + 20)
          << i << (user_sets ? "" : " without user sets");
  }
}

TEST_F(GvOpen, AnOffsetBeyondTheSensorOrAUserSetThatIsNotThereIsRefused) {
  backend().features = {{"OffsetX", "8"}};
  expect_failure(ErrorCode::refused, {"place the picture on the sensor", "OffsetX = 8"});
  backend().features = {{"OffsetX", "left"}};
  expect_failure(ErrorCode::invalid_input, {"OffsetX = left"});
  backend().features = {{"UserSetSelector", "UserSet7"}};
  expect_failure(ErrorCode::not_found, {"UserSet7", "UserSetSelector"});
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
