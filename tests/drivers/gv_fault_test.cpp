// Each fault of a GigE Vision camera and of its network, with the outcome that our driver promises.
#include <gtest/gtest.h>

#include <thread>

#include "tests/drivers/gv_camera_rig.h"

namespace lightrig {
namespace {

using namespace std::chrono_literals;
using sim::CameraFaultKind;

constexpr double exposure = 0.01;  // [s]

class GvFault : public test::GvCameraTest {
 protected:
  void SetUp() override {
    GvCameraTest::SetUp();
    if (IsSkipped() || HasFatalFailure()) return;
    backend().packet_size = 576;  // a frame of this small picture is a dozen packets
    reopen();
  }

  void reopen() {
    camera_.reset();
    auto opened = open();
    ASSERT_TRUE(opened) << opened.error().message;
    camera_ = std::move(*opened);
  }

  Result<Frame> expose() { return camera_->expose(exposure, soon(20)); }

  /// A frame is whole, of the exposure asked for, and shows what the laboratory last rendered.
  void expect_good_frame() {
    const auto frame = expose();
    ASSERT_TRUE(frame) << frame.error().message;
    EXPECT_EQ(frame->exposure, exposure);
    EXPECT_EQ(last_record().exposure, exposure);
    EXPECT_EQ(frame->counts.counts.size(), 64U * 48U);
  }

  void expect_refused_frame(std::string_view because) {
    const std::uint64_t rejected = camera_->counters().rejected;
    const auto frame = expose();
    ASSERT_FALSE(frame);
    EXPECT_EQ(frame.error().code, ErrorCode::timed_out) << frame.error().message;
    EXPECT_NE(frame.error().message.find(because), std::string::npos) << frame.error().message;
    EXPECT_EQ(camera_->counters().rejected, rejected + 1);
  }

  /// Exposes until the driver says the camera is gone, which it must within a few attempts.
  void expect_disconnected_soon() {
    for (int attempt = 0; attempt < 4; ++attempt) {
      const auto frame = expose();
      ASSERT_FALSE(frame) << "a frame came from a camera that lost its settings";
      if (frame.error().code == ErrorCode::disconnected) return;
      EXPECT_EQ(frame.error().code, ErrorCode::timed_out) << frame.error().message;
    }
    FAIL() << "the driver never said that the camera is gone";
  }

  std::unique_ptr<Camera> camera_;
};

TEST_F(GvFault, APacketLostIsAskedForAgainAndTheFrameIsWhole) {
  for (const auto kind : {CameraFaultKind::packet_lost, CameraFaultKind::trailer_lost}) {
    const std::uint64_t resent = camera_->counters().packets_resent;
    faults_->add_next(kind);
    expect_good_frame();
    EXPECT_GT(camera_->counters().packets_resent, resent) << sim::name_of(kind);
  }
  EXPECT_EQ(camera_->counters().rejected, 0U);
}

TEST_F(GvFault, PacketsOutOfOrderOrTwiceMakeAWholeFrame) {
  for (const auto kind : {CameraFaultKind::packets_reordered, CameraFaultKind::packets_doubled}) {
    faults_->add_next(kind);
    expect_good_frame();
  }
  EXPECT_EQ(faults_->struck().size(), 2U);
}

TEST_F(GvFault, AFrameThatStaysIncompleteIsRefusedAndTheNextIsGood) {
  for (const auto kind : {CameraFaultKind::packet_gone, CameraFaultKind::leader_gone}) {
    faults_->add_next(kind);
    expect_refused_frame("");
    expect_good_frame();
  }
}

TEST_F(GvFault, AFrameOfAnotherExposureThanItsRegisterSaysIsRefused) {
  faults_->add_next(CameraFaultKind::wrong_exposure);
  expect_refused_frame("exposed for 0.02 s instead of 0.01 s");
  EXPECT_EQ(last_record().exposure, 2 * exposure) << "the laboratory did expose twice as long";
  expect_good_frame();
}

TEST_F(GvFault, AStaleFrameIsRefused) {
  expect_good_frame();
  faults_->add_next(CameraFaultKind::stale_frame);
  expect_refused_frame("stale");
  expect_good_frame();
}

TEST_F(GvFault, AFrameOfHalfTheRowsIsRefused) {
  faults_->add_next(CameraFaultKind::wrong_size);
  expect_refused_frame("pixels came");
  expect_good_frame();
}

TEST_F(GvFault, AFrozenCameraIsGoneAndWorksAgainOnceThawedAndReopened) {
  faults_->add_next(CameraFaultKind::frozen, 5);
  expect_disconnected_soon();
  camera_.reset();
  Result<std::unique_ptr<Camera>> again = fail(ErrorCode::not_found, "not tried");
  for (int attempt = 0; attempt < 10 && !again; ++attempt) again = open();
  ASSERT_TRUE(again) << again.error().message;
  camera_ = std::move(*again);
  expect_good_frame();
}

TEST_F(GvFault, ARebootedCameraIsReopenedWithItsSettingsWrittenAndReadBackAnew) {
  faults_->add_next(CameraFaultKind::rebooted, 0.2);
  expect_disconnected_soon();
  reopen();
  expect_good_frame();
}

TEST_F(GvFault, ACameraInOtherHandsIsRefusedUntilItIsFree) {
  faults_->add_next(CameraFaultKind::privilege_stolen, 10);
  expect_disconnected_soon();
  camera_.reset();
  const auto meanwhile = open();
  ASSERT_FALSE(meanwhile);
  EXPECT_EQ(meanwhile.error().code, ErrorCode::refused) << meanwhile.error().message;
  EXPECT_NE(meanwhile.error().message.find("another program"), std::string::npos);
  Result<std::unique_ptr<Camera>> again = fail(ErrorCode::refused, "not tried");
  for (int attempt = 0; attempt < 40 && !again; ++attempt) {
    std::this_thread::sleep_for(500ms);
    again = open();
  }
  ASSERT_TRUE(again) << again.error().message;
  camera_ = std::move(*again);
  expect_good_frame();
}

TEST_F(GvFault, OnePercentLossWithResendLosesNoFrame) {
  faults_->lose(0.01, true, 7);
  for (int i = 0; i < 150; ++i) {
    const auto frame = camera_->expose(1e-4, soon(20));
    ASSERT_TRUE(frame) << "frame " << i << ": " << frame.error().message;
  }
  EXPECT_GT(faults_->packets_lost(), 10U);
  EXPECT_GE(camera_->counters().packets_resent, 10U);
  EXPECT_EQ(camera_->counters().rejected, 0U);
}

TEST_F(GvFault, LossWithoutResendIsRefusedFramesNeverIncompleteOnes) {
  // A second laboratory that renders the same frames tells what each ought to show.
  auto clock = sim::make_clock(std::numeric_limits<double>::infinity());
  sim::RenderOptions options;
  options.threads = 1;
  sim::World twin(rig_, make_sphere(0.05, 2), sim::lambert(0.5), *clock, 1, options);
  faults_->lose(0.05, false, 3);
  int whole = 0;
  int refused = 0;
  for (int i = 0; i < 25; ++i) {
    const auto frame = expose();
    const auto ought = twin.expose(twin.look(), exposure, {});
    ASSERT_TRUE(ought);
    if (frame) {
      ++whole;
      ASSERT_EQ(frame->counts.counts, ought->counts.counts) << "frame " << i;
    } else {
      ++refused;
      EXPECT_EQ(frame.error().code, ErrorCode::timed_out) << frame.error().message;
    }
  }
  EXPECT_GT(whole, 0);
  EXPECT_GT(refused, 3);
}

}  // namespace
}  // namespace lightrig
