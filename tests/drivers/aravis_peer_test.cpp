// Our camera driver against an independent peer: Aravis' own fake GigE Vision camera, over real
// GVCP and GVSP.
#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <set>
#include <thread>

#include "drivers/backends.h"
#include "tests/drivers/child_process.h"
#include "tests/drivers/gv_camera_rig.h"
#include "tests/drivers/own_network.h"

namespace lightrig {
namespace {

using namespace std::chrono_literals;

constexpr int stock_receive_ceiling = 212992;  // [byte] net.core.rmem_max, untouched

class AravisPeer : public testing::Test {
 protected:
  void SetUp() override {
    if (backends().back().built == false) GTEST_SKIP() << "Aravis is left out of this build";
    const std::string obstacle = test::enter_own_network();
    if (!obstacle.empty()) GTEST_SKIP() << obstacle;
    fake_ = std::make_unique<test::ChildProcess>(
        std::vector<std::string>{"arv-fake-gv-camera-0.8", "-i", "127.0.0.1", "-s", "GV02"});
    rig_.camera.model.width = 160;
    rig_.camera.model.height = 120;
    rig_.camera.sensor.bits = 8;
    rig_.camera.sensor.min_exposure = 1e-4;
    rig_.camera.sensor.max_exposure = 1;
    backend_.id = "127.0.0.1";
    // The peer sends a frame in one burst, which must fit into the receive buffer: into that of a
    // kernel as it comes, whatever this one allows.
    backend_.socket_buffer_bytes = std::min(test::receive_ceiling(), stock_receive_ceiling);
  }

  Result<std::unique_ptr<Camera>> open() {
    Result<std::unique_ptr<Camera>> camera = fail(ErrorCode::not_found, "not tried");
    for (int attempt = 0; attempt < 20 && !camera; ++attempt) {  // the peer takes a moment to start
      std::this_thread::sleep_for(100ms);
      camera = open_camera(rig_, backend_, clock_);
    }
    return camera;
  }

  Until soon(std::chrono::milliseconds time) { return {clock_.now() + time, stop_.get_token()}; }

  RealClock clock_;
  std::stop_source stop_;
  std::unique_ptr<test::ChildProcess> fake_;
  Rig rig_;
  AravisCamera backend_;
};

TEST_F(AravisPeer, GivesWholeFramesWithFreshIdsAndTheExposureAskedFor) {
  auto camera = open();
  ASSERT_TRUE(camera) << camera.error().message;
  std::set<std::uint64_t> ids;
  for (double exposure : {0.001, 0.01, 0.002}) {
    const auto frame = (*camera)->expose(exposure, soon(5s));
    ASSERT_TRUE(frame) << frame.error().message;
    EXPECT_NEAR(frame->exposure, exposure, 1e-5);
    EXPECT_EQ(frame->counts.counts.size(), 160U * 120U);
    EXPECT_TRUE(ids.insert(frame->id).second) << frame->id;
  }
  EXPECT_EQ((*camera)->counters().frames, 3U);
  EXPECT_NE((*camera)->identity().find("GV02"), std::string::npos) << (*camera)->identity();
}

TEST_F(AravisPeer, RefusesAnImageSizeThatTheCameraDoesNotGive) {
  ASSERT_TRUE(open());
  rig_.camera.model.width = 100000;
  const auto camera = open_camera(rig_, backend_, clock_);
  ASSERT_FALSE(camera);
  EXPECT_NE(camera.error().message.find("image size"), std::string::npos) << camera.error().message;
}

TEST_F(AravisPeer, ASecondControllerIsRefused) {
  auto first = open();
  ASSERT_TRUE(first) << first.error().message;
  const auto second = open_camera(rig_, backend_, clock_);
  ASSERT_FALSE(second);
  EXPECT_EQ(second.error().code, ErrorCode::refused) << second.error().message;
}

TEST_F(AravisPeer, AStopRequestEndsAnExposureAtOnceEvenWhenTheCameraIsDead) {
  auto camera = open();
  ASSERT_TRUE(camera) << camera.error().message;
  fake_->freeze();  // every register call now blocks for seconds
  std::jthread stopper([&] {
    std::this_thread::sleep_for(200ms);
    stop_.request_stop();
  });
  const auto begin = std::chrono::steady_clock::now();
  const auto frame = (*camera)->expose(0.001, soon(30s));
  const auto took = std::chrono::steady_clock::now() - begin;
  ASSERT_FALSE(frame);
  EXPECT_EQ(frame.error().code, ErrorCode::stopped) << frame.error().message;
  EXPECT_LT(took, 2s) << "a register of a dead camera takes longer";
  fake_->signal(SIGCONT);
}

TEST_F(AravisPeer, ADeadCameraIsSaidToBeGone) {
  auto camera = open();
  ASSERT_TRUE(camera) << camera.error().message;
  fake_->end();
  const auto frame = (*camera)->expose(0.001, soon(20s));
  ASSERT_FALSE(frame);
  EXPECT_EQ(frame.error().code, ErrorCode::disconnected) << frame.error().message;
}

TEST_F(AravisPeer, NobodyAtTheAddressSaysWhatToCheck) {
  backend_.id = "127.0.0.77";
  const auto camera = open_camera(rig_, backend_, clock_);
  ASSERT_FALSE(camera);
  EXPECT_EQ(camera.error().code, ErrorCode::not_found) << camera.error().message;
  EXPECT_NE(camera.error().message.find("lightrig devices"), std::string::npos);
}

}  // namespace
}  // namespace lightrig
