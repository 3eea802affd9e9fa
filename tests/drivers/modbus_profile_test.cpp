// Every controller profile that is shipped drives a gantry: homes, moves, stops, on the transport
// that it is for. What a drive would refuse (a rate of 0, a request too soon after an answer) the
// simulated one does.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <chrono>
#include <filesystem>
#include <thread>
#include <tuple>

#include "drivers/modbus/modbus_drive.h"
#include "tests/drivers/own_network.h"
#include "tests/drivers/wire_rig.h"

namespace lightrig {
namespace {

using namespace std::chrono_literals;
using testing::ElementsAre;
using testing::HasSubstr;

ControllerProfile profile_of(const std::string& name) {
  const auto read =
      read_profile(std::filesystem::path(test::source_dir) / "config" / "controllers" / name);
  EXPECT_TRUE(read.value) << name;
  return *read.value;
}

class ModbusProfile : public testing::TestWithParam<const char*>, protected test::ModbusLab {
 protected:
  void SetUp() override {
    const ControllerProfile profile = profile_of(GetParam());
    const auto kind = profile.rtu ? test::ModbusWireKind::rtu : test::ModbusWireKind::tcp;
    if (const std::string obstacle = connect_by(kind); !obstacle.empty()) GTEST_SKIP() << obstacle;
    backend_.controller = profile;
    for (ModbusDrive& drive : backend_.drives) drive.counts_per_rev = 10000;
    if (profile.watchdog) backend_.timeout = profile.watchdog->timeout / 7;
    // A lamp of its own: not every controller has an output for one.
    ModbusLamp lamp;
    lamp.endpoint = backend_.drives.front().endpoint;
    lamp.unit = 9;
    lamp.coil = 3;
    rig_.lamp.backend = lamp;
    rig_.interlocks.clear();
    ASSERT_NO_FATAL_FAILURE(host());
  }

  void expect_moved(Gantry& gantry, const GantryPosition& target) {
    const auto moved = gantry.move_to(target, soon(20s));
    ASSERT_TRUE(moved) << moved.error().message;
    EXPECT_LE((world_->gantry_status().position.axes - target.axes).cwiseAbs().maxCoeff(),
              rig_.gantry.model.tolerance);
  }
};

// The second axis goes a hundredth of the first one's way, then less than a count, then none: what
// it is told must still be a speed and an acceleration that its registers hold.
TEST_P(ModbusProfile, DrivesAxesThatHaveVeryUnequalWaysToGo) {
  auto opened = open();
  ASSERT_TRUE(opened) << opened.error().message;
  const auto homed = opened->gantry->home(soon(30s));
  ASSERT_TRUE(homed) << homed.error().message;
  const double count = 1 / std::abs(backend_.drives[1].counts_per_si);
  ASSERT_NO_FATAL_FAILURE(expect_moved(*opened->gantry, test::at_degrees(50, 30)));
  ASSERT_NO_FATAL_FAILURE(expect_moved(*opened->gantry, test::at_degrees(-50, 31)));
  GantryPosition nearly = test::at_degrees(50, 31);
  nearly.axes[1] += 0.4 * count;
  ASSERT_NO_FATAL_FAILURE(expect_moved(*opened->gantry, nearly));
  nearly.axes[0] = 0.3;
  nearly.axes[1] += 2 * count;
  ASSERT_NO_FATAL_FAILURE(expect_moved(*opened->gantry, nearly));
}

TEST_P(ModbusProfile, StopsEveryDriveOnRequest) {
  auto opened = open();
  ASSERT_TRUE(opened) << opened.error().message;
  ASSERT_TRUE(opened->gantry->home(soon(30s)));
  const std::jthread stopper = stops_once_moving(80ms);
  const auto moved = opened->gantry->move_to(test::at_degrees(150, 80), soon(30s));
  ASSERT_FALSE(moved);
  EXPECT_EQ(moved.error().code, ErrorCode::stopped) << moved.error().message;
  EXPECT_TRUE(comes_to_rest()) << "a drive that is not told goes on";
  EXPECT_GT(150 * 0.01745 - world_->gantry_status().position.axes[0], 0.1);
}

INSTANTIATE_TEST_SUITE_P(Each, ModbusProfile,
                         testing::Values("generic.toml", "oriental_az.toml", "leadshine_pr.toml"),
                         [](const auto& one) {
                           const std::string file = one.param;
                           return file.substr(0, file.find('_') == std::string::npos
                                                     ? file.find('.')
                                                     : file.find('_'));
                         });

/// What registers would hold, without a wire.
TEST(ModbusWords, OfASlowAxisAreAtLeastOneUnitAndAtMostWhatTheRegisterHolds) {
  const ControllerProfile profile = profile_of("leadshine_pr.toml");
  ModbusDrive config;
  config.counts_per_si = 10000 / 6.283185307179586;
  config.counts_per_rev = 10000;
  const auto words = [&](double speed, double acceleration) {
    return composed(config, profile.move, {1, speed, acceleration}).value().front().words;
  };
  // mode, position (two), rpm, ms per 1000 rpm twice, pause, start
  EXPECT_THAT(words(6.283185307179586, 104.71975511965977),
              ElementsAre(1, 0, 1592, 60, 1000, 1000, 0, 0x10));
  EXPECT_THAT(words(1e-6, 1e-6), ElementsAre(1, 0, 1592, 1, 65535, 65535, 0, 0x10));
}

TEST(ModbusWords, RefuseLimitsThatTheRegistersCannotHold) {
  const ControllerProfile profile = profile_of("leadshine_pr.toml");
  ModbusDrive config;
  config.axis = "azimuth";
  config.counts_per_si = 10000 / 6.283185307179586;
  config.counts_per_rev = 10000;
  EXPECT_TRUE(can_hold_limits(config, profile.move, 1, 100));
  const auto slow = can_hold_limits(config, profile.move, 0.05, 100);
  ASSERT_FALSE(slow) << "half a revolution a minute";
  EXPECT_THAT(slow.error().message, HasSubstr("greatest speed is 0.477"));
  const auto lazy = can_hold_limits(config, profile.move, 1, 1);
  ASSERT_FALSE(lazy);
  EXPECT_THAT(lazy.error().message, HasSubstr("greatest acceleration is 1.05e+05"));
}

TEST(ModbusSpans, JoinWhatTouchesAndNothingElse) {
  using T = RegisterTable;
  const auto joined_of = [](std::vector<RegisterSpan> spans) {
    std::vector<std::tuple<T, int, int>> out;
    for (const RegisterSpan& s : joined(std::move(spans)))
      out.emplace_back(s.table, s.address, s.count);
    return out;
  };
  EXPECT_THAT(joined_of({{T::holding, 0x202, 1}, {T::holding, 0x200, 2}, {T::holding, 0x202, 1}}),
              ElementsAre(std::tuple(T::holding, 0x200, 3)));
  EXPECT_THAT(joined_of({{T::holding, 4, 1}, {T::holding, 2, 1}, {T::input, 3, 1}}),
              ElementsAre(std::tuple(T::holding, 2, 1), std::tuple(T::holding, 4, 1),
                          std::tuple(T::input, 3, 1)));
  EXPECT_THAT(joined_of({{T::holding, 0, 100}, {T::holding, 100, 26}}),
              ElementsAre(std::tuple(T::holding, 0, 100), std::tuple(T::holding, 100, 26)))
      << "one request reads 125 at most";
}

}  // namespace
}  // namespace lightrig
