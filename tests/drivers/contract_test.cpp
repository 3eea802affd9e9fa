#include "tests/drivers/contract.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <limits>
#include <thread>

#include "tests/sim/lab_rig.h"

// What every Gantry, Lamp and Camera promises (drivers/devices.h), whatever it is made of.

namespace lightrig {

using namespace std::chrono_literals;
using std::chrono::steady_clock;

Until DeviceContract::within(double seconds, std::stop_token stop) const {
  const auto time = std::chrono::nanoseconds(std::llround(seconds * 1e9));
  return {subject.clock->now() + time, std::move(stop)};
}

GantryPosition DeviceContract::beside_home(double first, double second) const {
  const std::vector<Axis>& axes = subject.rig.gantry.model.axes;
  GantryPosition position;
  position.axes.resize(static_cast<Eigen::Index>(axes.size()));
  for (std::size_t i = 0; i < axes.size(); ++i) {
    const double share = i == 0 ? first : i == 1 ? second : 0;
    position.axes[static_cast<Eigen::Index>(i)] =
        axes[i].home + share * (axes[i].max - axes[i].home);
  }
  return position;
}

namespace {

constexpr double ample = 60;  // [s]

/// Real time until a call returns after a stop request; the promise is 10 ms, the rest is slack for
/// a loaded machine.
constexpr auto stop_latency = 60ms;

template <class Call>
steady_clock::duration latency_of_one_stop(const Call& call) {
  std::stop_source source;
  steady_clock::time_point returned;
  std::jthread caller([&] {
    call(source.get_token());
    returned = steady_clock::now();
  });
  std::this_thread::sleep_for(100ms);
  const auto asked = steady_clock::now();
  source.request_stop();
  caller.join();
  return returned - asked;
}

/// The least of a few tries: on a loaded machine one of them may have waited for its turn.
/// `between` is done after each.
template <class Call, class Between>
steady_clock::duration latency_of_stop(const Call& call, const Between& between) {
  auto least = steady_clock::duration::max();
  for (int attempt = 0; attempt < 5 && least >= stop_latency; ++attempt) {
    least = std::min(least, latency_of_one_stop(call));
    between();
  }
  return least;
}

TEST_P(DeviceContract, AMoveIsRefusedWhileThePositionIsUnknown) {
  const auto status = subject.devices.gantry->status(within(ample));
  ASSERT_TRUE(status) << status.error().message;
  if (status->homed) {  // this far end remembers its position over power cycles
    EXPECT_TRUE(subject.devices.gantry->move_to(beside_home(0.1, 0.1), within(ample)));
    return;
  }
  const auto moved = subject.devices.gantry->move_to(beside_home(0.1, 0.1), within(ample));
  ASSERT_FALSE(moved);
  EXPECT_EQ(moved.error().code, ErrorCode::refused);
  EXPECT_FALSE(moved.error().message.empty());
}

TEST_P(DeviceContract, HomingEndsAtRestAtTheHomePosition) {
  const auto homed = subject.devices.gantry->home(within(ample));
  ASSERT_TRUE(homed) << homed.error().message;
  const auto status = subject.devices.gantry->status(within(ample));
  ASSERT_TRUE(status);
  EXPECT_TRUE(status->homed);
  EXPECT_TRUE(status->at_rest);
  EXPECT_EQ(status->alarm, "");
  const AxisValues off = status->position.axes - beside_home(0, 0).axes;
  EXPECT_LE(off.cwiseAbs().maxCoeff(), subject.rig.gantry.model.tolerance);
}

TEST_P(DeviceContract, AMoveReturnsAtRestWithinTolerance) {
  ASSERT_TRUE(subject.devices.gantry->home(within(ample)));
  for (const auto& [first, second] : {std::pair(0.2, 0.3), {0.21, 0.3}, {0.0, 0.0}, {0.3, 0.1}}) {
    const GantryPosition target = beside_home(first, second);
    const auto moved = subject.devices.gantry->move_to(target, within(ample));
    ASSERT_TRUE(moved) << moved.error().message;
    const auto status = subject.devices.gantry->status(within(ample));
    ASSERT_TRUE(status);
    EXPECT_TRUE(status->at_rest);
    EXPECT_LE((status->position.axes - target.axes).cwiseAbs().maxCoeff(),
              subject.rig.gantry.model.tolerance);
  }
}

TEST_P(DeviceContract, AMoveToWhereItStandsSucceeds) {
  ASSERT_TRUE(subject.devices.gantry->home(within(ample)));
  const GantryPosition target = beside_home(0.1, 0.1);
  ASSERT_TRUE(subject.devices.gantry->move_to(target, within(ample)));
  EXPECT_TRUE(subject.devices.gantry->move_to(target, within(ample)));
}

TEST_P(DeviceContract, AMoveBeyondTheTravelIsRefusedAndNothingMoves) {
  ASSERT_TRUE(subject.devices.gantry->home(within(ample)));
  const std::vector<Axis>& axes = subject.rig.gantry.model.axes;
  for (std::size_t i = 0; i < axes.size(); ++i) {
    for (const double value :
         {axes[i].min - 0.01, axes[i].max + 0.01, std::numeric_limits<double>::quiet_NaN(),
          std::numeric_limits<double>::infinity()}) {
      GantryPosition beyond = beside_home(0, 0);
      beyond.axes[static_cast<Eigen::Index>(i)] = value;
      const auto moved = subject.devices.gantry->move_to(beyond, within(ample));
      ASSERT_FALSE(moved) << axes[i].name << " to " << value;
      EXPECT_EQ(moved.error().code, ErrorCode::refused);
    }
  }
  GantryPosition short_of_axes;
  short_of_axes.axes = AxisValues::Zero(1);
  EXPECT_FALSE(subject.devices.gantry->move_to(short_of_axes, within(ample)));
  const auto status = subject.devices.gantry->status(within(ample));
  ASSERT_TRUE(status);
  EXPECT_LE((status->position.axes - beside_home(0, 0).axes).cwiseAbs().maxCoeff(),
            subject.rig.gantry.model.tolerance);
}

TEST_P(DeviceContract, AMoveThatMissesItsDeadlineTimesOutAndIsHalted) {
  ASSERT_TRUE(subject.devices.gantry->home(within(ample)));
  const auto moved = subject.devices.gantry->move_to(beside_home(0.8, 0), within(0.4));
  ASSERT_FALSE(moved);
  EXPECT_EQ(moved.error().code, ErrorCode::timed_out);
  subject.clock->sleep_until(within(1.5).deadline, {});
  const auto rested = subject.devices.gantry->status(within(ample));
  ASSERT_TRUE(rested);
  EXPECT_TRUE(rested->at_rest);
  EXPECT_GT((rested->position.axes - beside_home(0.8, 0).axes).cwiseAbs().maxCoeff(),
            subject.rig.gantry.model.tolerance);
}

TEST_P(DeviceContractInTime, AStoppedMoveReturnsAtOnceAndComesToRestShortOfItsTarget) {
  ASSERT_TRUE(subject.devices.gantry->home(within(ample)));
  ErrorCode code = ErrorCode::invalid_input;
  const auto come_to_rest = [this] { subject.clock->sleep_until(within(1.5).deadline, {}); };
  const auto latency = latency_of_stop(
      [&](std::stop_token stop) {
        const auto moved =
            subject.devices.gantry->move_to(beside_home(0.9, 0), within(ample, stop));
        if (!moved) code = moved.error().code;
      },
      come_to_rest);
  EXPECT_EQ(code, ErrorCode::stopped);
  EXPECT_LT(latency, stop_latency);
  const auto status = subject.devices.gantry->status(within(ample));
  ASSERT_TRUE(status);
  EXPECT_TRUE(status->at_rest);
  EXPECT_GT(std::abs(status->position.axes[0] - beside_home(0.9, 0).axes[0]),
            subject.rig.gantry.model.tolerance);
  EXPECT_TRUE(subject.devices.gantry->move_to(beside_home(0.1, 0), within(ample)))
      << "the gantry is not usable after a stop";
}

TEST_P(DeviceContract, NoCallBeginsWithoutTimeOrAfterAStop) {
  std::stop_source source;
  source.request_stop();
  const Until stopped = within(ample, source.get_token());
  EXPECT_EQ(subject.devices.gantry->home(stopped).error().code, ErrorCode::stopped);
  EXPECT_EQ(subject.devices.gantry->status(stopped).error().code, ErrorCode::stopped);
  EXPECT_EQ(subject.devices.lamp->set(0, stopped).error().code, ErrorCode::stopped);
  EXPECT_EQ(subject.devices.lamp->state(stopped).error().code, ErrorCode::stopped);
  EXPECT_EQ(subject.devices.camera->expose(0.01, stopped).error().code, ErrorCode::stopped);
  const Until past = within(-1);
  EXPECT_EQ(subject.devices.gantry->home(past).error().code, ErrorCode::timed_out);
  EXPECT_EQ(subject.devices.gantry->status(past).error().code, ErrorCode::timed_out);
  EXPECT_EQ(subject.devices.lamp->set(0, past).error().code, ErrorCode::timed_out);
  EXPECT_EQ(subject.devices.camera->expose(0.01, past).error().code, ErrorCode::timed_out);
}

TEST_P(DeviceContract, TheLampDoesWhatItIsToldAndNoMoreThanItsMaximum) {
  const double maximum = subject.rig.lamp.max_power;
  for (const double power : {0.0, maximum, maximum / 2, 0.0}) {
    const auto set = subject.devices.lamp->set(power, within(ample));
    ASSERT_TRUE(set) << set.error().message;
    const auto state = subject.devices.lamp->state(within(ample));
    ASSERT_TRUE(state);
    const bool on_or_off_only = state->power == 0 || state->power == maximum;
    EXPECT_TRUE(std::abs(state->power - power) < 0.01 || (power > 0 && on_or_off_only));
  }
  for (const double power : {-0.1, maximum + 0.05, 2.0, std::numeric_limits<double>::quiet_NaN()}) {
    const auto set = subject.devices.lamp->set(power, within(ample));
    ASSERT_FALSE(set) << power;
    EXPECT_EQ(set.error().code, ErrorCode::refused);
  }
  EXPECT_EQ(subject.devices.lamp->state(within(ample))->power, 0);
}

TEST_P(DeviceContract, ALampDestroyedIsDark) {
  ASSERT_TRUE(subject.devices.lamp->set(0.5, within(ample)));
  subject.devices.lamp.reset();
  if (!subject.lamp_power_at_far_end) GTEST_SKIP() << "this far end does not tell";
  EXPECT_EQ(subject.lamp_power_at_far_end(), 0);
}

TEST_P(DeviceContractInTime, AGantryDestroyedComesToRest) {
  if (!subject.moving_at_far_end) GTEST_SKIP() << "this far end does not tell";
  ASSERT_TRUE(subject.devices.gantry->home(within(ample)));
  std::stop_source source;
  std::jthread mover([&] {
    static_cast<void>(
        subject.devices.gantry->move_to(beside_home(0.9, 0), within(ample, source.get_token())));
  });
  std::this_thread::sleep_for(100ms);
  source.request_stop();
  mover.join();
  subject.devices.gantry.reset();
  subject.clock->sleep_until(within(1.5).deadline, {});
  EXPECT_FALSE(subject.moving_at_far_end());
}

TEST_P(DeviceContract, AFrameIsWholeTakenAtItsExposureAndHasItsOwnNumber) {
  const CameraModel& model = subject.rig.camera.model;
  std::uint64_t last_id = 0;
  for (const double exposure : {0.001, 0.05, 0.05, 0.2}) {
    const auto frame = subject.devices.camera->expose(exposure, within(ample));
    ASSERT_TRUE(frame) << frame.error().message;
    EXPECT_EQ(frame->counts.width, model.width);
    EXPECT_EQ(frame->counts.height, model.height);
    EXPECT_EQ(frame->counts.counts.size(),
              static_cast<std::size_t>(model.width) * static_cast<std::size_t>(model.height));
    EXPECT_NEAR(frame->exposure, exposure, 0.01 * exposure + 2e-5);
    EXPECT_NE(frame->id, last_id);
    last_id = frame->id;
    for (const std::uint16_t count : frame->counts.counts) {
      ASSERT_LE(count, subject.rig.camera.sensor.white_level());
    }
  }
  EXPECT_GE(subject.devices.camera->counters().frames, 4U);
  EXPECT_FALSE(subject.devices.camera->identity().empty());
}

TEST_P(DeviceContract, AnExposureTheCameraCannotTakeIsRefused) {
  const SensorModel& sensor = subject.rig.camera.sensor;
  for (const double exposure : {0.0, -1.0, sensor.min_exposure / 2, sensor.max_exposure * 2,
                                std::numeric_limits<double>::quiet_NaN()}) {
    const auto frame = subject.devices.camera->expose(exposure, within(ample));
    ASSERT_FALSE(frame) << exposure;
    EXPECT_EQ(frame.error().code, ErrorCode::refused);
  }
  EXPECT_TRUE(subject.devices.camera->expose(0.01, within(ample)));
}

TEST_P(DeviceContract, AnExposureLongerThanItsDeadlineTimesOutAndTheNextOneWorks) {
  const auto frame = subject.devices.camera->expose(0.2, within(0.1));
  ASSERT_FALSE(frame);
  EXPECT_EQ(frame.error().code, ErrorCode::timed_out);
  const auto next = subject.devices.camera->expose(0.01, within(ample));
  ASSERT_TRUE(next) << next.error().message;
  EXPECT_NEAR(next->exposure, 0.01, 2e-4);
}

TEST_P(DeviceContractInTime, AStoppedExposureReturnsAtOnce) {
  const double longest = subject.rig.camera.sensor.max_exposure;
  ErrorCode code = ErrorCode::invalid_input;
  const auto latency = latency_of_stop(
      [&](std::stop_token stop) {
        const auto frame = subject.devices.camera->expose(longest, within(10 * longest, stop));
        if (!frame) code = frame.error().code;
      },
      [] {});
  EXPECT_EQ(code, ErrorCode::stopped);
  EXPECT_LT(latency, stop_latency);
}

TEST_P(DeviceContract, TheLampBrightensThePicture) {
  ASSERT_TRUE(subject.devices.gantry->home(within(ample)));
  // The brightest hundredth of the sites: the object fills part of the picture, black the rest.
  const auto bright = [](Frame frame) -> int {
    auto& counts = frame.counts.counts;
    const auto place = counts.begin() + static_cast<std::ptrdiff_t>(counts.size() * 99 / 100);
    std::nth_element(counts.begin(), place, counts.end());
    return *place;
  };
  const auto dark = subject.devices.camera->expose(0.05, within(ample));
  ASSERT_TRUE(subject.devices.lamp->set(subject.rig.lamp.max_power, within(ample)));
  const auto lit = subject.devices.camera->expose(0.05, within(ample));
  ASSERT_TRUE(subject.devices.lamp->set(0, within(ample)));
  const auto dark_again = subject.devices.camera->expose(0.05, within(ample));
  ASSERT_TRUE(dark && lit && dark_again);
  EXPECT_GT(bright(*lit), bright(*dark) + 10);
  EXPECT_NEAR(bright(*dark_again), bright(*dark), 3);
}

// --- the rig in memory, under a jumping and under a running clock

ContractSubject in_memory(double clock_rate) {
  auto lab = std::make_shared<sim::Lab>(sim::lab_rig(), 1, clock_rate);
  ContractSubject subject;
  subject.rig = sim::lab_rig();
  subject.clock = std::shared_ptr<Clock>(lab, lab->clock.get());
  subject.keep_alive = lab;
  subject.devices = std::move(lab->devices);
  subject.lamp_power_at_far_end = [world = lab->world] { return world->lamp_power(); };
  subject.moving_at_far_end = [world = lab->world] { return !world->gantry_status().at_rest; };
  return subject;
}

INSTANTIATE_TEST_SUITE_P(
    InMemory, DeviceContract,
    testing::Values(ContractBackend{"JumpingClock",
                                    [] {
                                      return in_memory(std::numeric_limits<double>::infinity());
                                    }},
                    ContractBackend{"RunningClock", [] { return in_memory(10); }}),
    [](const auto& backend) { return backend.param.name; });

INSTANTIATE_TEST_SUITE_P(InMemory, DeviceContractInTime,
                         testing::Values(ContractBackend{"RunningClock",
                                                         [] { return in_memory(10); }}),
                         [](const auto& backend) { return backend.param.name; });

}  // namespace
}  // namespace lightrig
