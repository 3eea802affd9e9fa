// Our camera driver against our simulated GigE Vision camera, over real GVCP and GVSP.
#include <gtest/gtest.h>

#include <algorithm>
#include <set>
#include <thread>

#include "drivers/pixel_format.h"
#include "tests/drivers/gv_camera_rig.h"

namespace lightrig {
namespace {

using namespace std::chrono_literals;

using GvCamera = test::GvCameraTest;

TEST_F(GvCamera, ShowsTheWorldAsTheInMemoryCameraDoesCountByCount) {
  auto camera = open();
  ASSERT_TRUE(camera) << camera.error().message;
  // The same laboratory once more, whose camera is in memory.
  auto clock = sim::make_clock(std::numeric_limits<double>::infinity());
  sim::RenderOptions options;
  options.threads = 1;
  auto twin = std::make_shared<sim::World>(rig_, make_sphere(0.05, 2), sim::lambert(0.5), *clock, 1,
                                           options);
  auto in_memory = sim::make_camera(twin);
  ASSERT_TRUE(world_->set_lamp(0.8));
  ASSERT_TRUE(twin->set_lamp(0.8));
  for (const double exposure : {0.002, 0.05, 0.002}) {
    const auto wire = (*camera)->expose(exposure, soon(10));
    ASSERT_TRUE(wire) << wire.error().message;
    const auto memory = in_memory->expose(exposure, {clock->now() + 10s, {}});
    ASSERT_TRUE(memory) << memory.error().message;
    EXPECT_EQ(wire->exposure, memory->exposure);
    EXPECT_EQ(wire->counts.width, memory->counts.width);
    EXPECT_EQ(wire->counts.height, memory->counts.height);
    EXPECT_EQ(wire->counts.counts, memory->counts.counts) << "at " << exposure << " s";
  }
}

TEST_F(GvCamera, TellsItsTemperatureWhereItIsWatchedAndAsksForItOnlyThen) {
  Rig watched = rig_;
  watched.pause.camera_temperature = PauseRule{60, 50, false};
  for (const Rig& rig : {rig_, watched}) {
    auto camera = open_camera(rig, backend(), clock_);
    ASSERT_TRUE(camera) << camera.error().message;
    ASSERT_TRUE((*camera)->expose(0.002, soon(10)));
    const auto celsius = (*camera)->counters().temperature_c;
    EXPECT_EQ(celsius.has_value(), rig.pause.camera_temperature.has_value());
    if (celsius) {
      EXPECT_DOUBLE_EQ(*celsius, 25);
    }
  }
}

TEST_F(GvCamera, ExposesForAsLongAsItWasTold) {
  auto camera = open();
  ASSERT_TRUE(camera) << camera.error().message;
  for (const double exposure : {0.3, 0.01}) {
    const auto begin = std::chrono::steady_clock::now();
    const auto frame = (*camera)->expose(exposure, soon(10));
    ASSERT_TRUE(frame) << frame.error().message;
    EXPECT_GE(std::chrono::steady_clock::now() - begin, std::chrono::duration<double>(exposure));
    EXPECT_EQ(last_record().exposure, exposure);
  }
}

/// Every format of a filter, each on a sensor of its own depth.
class GvFormat : public test::GvCameraTest, public testing::WithParamInterface<ColorFilter> {};

TEST_P(GvFormat, CarriesEveryCountThatTheSensorGave) {
  int carried = 0;
  for (const int bits : {8, 10, 12, 14, 16}) {
    if (!plain_pixel_format(GetParam(), bits)) continue;
    Rig rig = rig_;
    rig.camera.sensor.filter = GetParam();
    rig.camera.sensor.bits = bits;
    rig.camera.sensor.black_level = 8;
    rig.camera.sensor.response *= 30;                // bright enough for the highest bits
    rig.camera.sensor.gain = 10000.0 / (1 << bits);  // [electrons/DN] the full well is near white
    host(rig);
    ASSERT_TRUE(world_->set_lamp(0.8));
    for (const PixelFormat& format : pixel_formats()) {
      if (format.filter != GetParam() || format.bits != bits) continue;
      backend().pixel_format = format.name;
      auto camera = open();
      ASSERT_TRUE(camera) << format.name << ": " << camera.error().message;
      const auto frame = (*camera)->expose(0.02, soon(10));
      ASSERT_TRUE(frame) << format.name << ": " << frame.error().message;
      EXPECT_EQ(sim::content_of(frame->counts), last_record().content) << format.name;
      const auto most = std::ranges::max(frame->counts.counts);
      EXPECT_GT(most, 1 << (bits - 3)) << format.name << " shows too little of its depth";
      ++carried;
    }
  }
  EXPECT_GE(carried, 8) << "plain, packed and p";
}

INSTANTIATE_TEST_SUITE_P(Of, GvFormat,
                         testing::Values(ColorFilter::mono, ColorFilter::bayer_rggb,
                                         ColorFilter::bayer_bggr, ColorFilter::bayer_grbg,
                                         ColorFilter::bayer_gbrg),
                         [](const auto& filter) {
                           return std::string(plain_pixel_format(filter.param, 8)->name);
                         });

TEST_F(GvCamera, ASecondControllerIsRefusedAndMayHaveItAfterwards) {
  auto first = open();
  ASSERT_TRUE(first) << first.error().message;
  const auto second = open();
  ASSERT_FALSE(second);
  EXPECT_EQ(second.error().code, ErrorCode::refused) << second.error().message;
  EXPECT_TRUE((*first)->expose(0.01, soon(5)));
  first->reset();
  const auto third = open();
  EXPECT_TRUE(third) << third.error().message;
}

TEST_F(GvCamera, TheSoftwareTriggerTakesOneFrameEach) {
  backend().trigger = "software";
  auto camera = open();
  ASSERT_TRUE(camera) << camera.error().message;
  const std::uint64_t before = faults_->frames();
  std::set<std::uint64_t> ids;
  for (int i = 0; i < 5; ++i) {
    const auto frame = (*camera)->expose(0.01, soon(5));
    ASSERT_TRUE(frame) << frame.error().message;
    EXPECT_TRUE(ids.insert(frame->id).second);
  }
  EXPECT_EQ(faults_->frames(), before + 5);
}

TEST_F(GvCamera, AnAddressThatIsNotThisMachinesOrIsTakenIsRefusedWithTheRemedy) {
  auto elsewhere = backend();
  elsewhere.id = "192.0.2.1";
  const auto away = sim::host_wire(rig_, elsewhere, world_);
  ASSERT_FALSE(away);
  EXPECT_EQ(away.error().code, ErrorCode::refused);
  EXPECT_NE(away.error().message.find("ip address add"), std::string::npos) << away.error().message;
  const auto taken = sim::host_wire(rig_, backend(), world_);
  ASSERT_FALSE(taken);
  EXPECT_NE(taken.error().message.find("no other camera"), std::string::npos)
      << taken.error().message;
}

TEST_F(GvCamera, TwoCamerasOnOneHostAreToldApartByAddress) {
  auto second = backend();
  second.id = "127.0.0.2";
  const auto hosted = sim::host_wire(rig_, second, world_);
  ASSERT_TRUE(hosted) << hosted.error().message;
  const auto one = open_camera(rig_, backend(), clock_);
  ASSERT_TRUE(one) << one.error().message;
  const auto two = open_camera(rig_, second, clock_);
  ASSERT_TRUE(two) << two.error().message;
  EXPECT_TRUE((*one)->expose(0.01, soon(5)));
  EXPECT_TRUE((*two)->expose(0.01, soon(5)));
}

TEST_F(GvCamera, IsFoundByItsSerialNumber) {
  hosted_.clear();
  backend().id = "lightrig-Simulated-LAB7";
  auto hosted = sim::host_wire(rig_, backend(), world_, faults_);
  ASSERT_TRUE(hosted) << hosted.error().message;
  for (const char* id : {"lightrig-Simulated-LAB7", "LAB7"}) {
    auto by = backend();
    by.id = id;
    const auto camera = open_camera(rig_, by, clock_);
    ASSERT_TRUE(camera) << id << ": " << camera.error().message;
    EXPECT_NE((*camera)->identity().find("LAB7"), std::string::npos) << (*camera)->identity();
  }
}

}  // namespace
}  // namespace lightrig
