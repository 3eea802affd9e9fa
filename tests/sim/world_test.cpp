#include "sim/world.h"

#include <gtest/gtest.h>
#include <pthread.h>
#include <sched.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <semaphore>
#include <thread>

#include "tests/sim/lab_rig.h"

namespace lightrig::sim {
namespace {

using namespace std::chrono_literals;

double total(const Frame& frame) {
  double sum = 0;
  for (const std::uint16_t count : frame.counts.counts) sum += count;
  return sum;
}

Frame shoot(Lab& lab, double exposure) {
  auto frame = lab.devices.camera->expose(exposure, lab.within(60));
  EXPECT_TRUE(frame) << (frame ? "" : frame.error().message);
  return *frame;
}

void go(Lab& lab, double azimuth, double elevation, double settle) {
  ASSERT_TRUE(lab.devices.gantry->move_to(dome_position(azimuth, elevation), lab.within(60)));
  lab.wait(settle);
}

TEST(World, TheSameSeedGivesTheSameBytesWhateverCameBeforeAndOnAnyNumberOfThreads) {
  Lab first(lab_rig(), 7), second(lab_rig(), 7, std::numeric_limits<double>::infinity(), 5);
  ASSERT_TRUE(first.devices.gantry->home(first.within(60)));
  ASSERT_TRUE(second.devices.gantry->home(second.within(60)));
  ASSERT_TRUE(first.devices.lamp->set(0.8, first.within(1)));
  ASSERT_TRUE(second.devices.lamp->set(0.8, second.within(1)));
  // The second laboratory has lived another life: other places, other exposures, the same shot cut
  // off half-way.
  go(second, 1.0, 1.0, 5);
  shoot(second, 0.1);
  go(second, -0.4, 0.9, 5);
  shoot(second, 0.05);
  second.wait(12.345);
  go(first, -0.4, 0.9, 5);
  go(second, -0.4, 0.9, 6);
  for (const double exposure : {0.05, 0.2, 0.05}) {
    EXPECT_EQ(shoot(first, exposure).counts.counts, shoot(second, exposure).counts.counts);
  }
  Lab other_seed(lab_rig(), 8);
  ASSERT_TRUE(other_seed.devices.gantry->home(other_seed.within(60)));
  ASSERT_TRUE(other_seed.devices.lamp->set(0.8, other_seed.within(1)));
  go(other_seed, -0.4, 0.9, 5);
  go(first, -0.4, 0.9, 5);
  EXPECT_NE(shoot(first, 0.05).counts.counts, shoot(other_seed, 0.05).counts.counts);
}

TEST(World, IdenticalRequestsDifferAndARetakeDiffersToo) {
  Lab lab(lab_rig());
  ASSERT_TRUE(lab.devices.gantry->home(lab.within(60)));
  const Frame first = shoot(lab, 0.1), second = shoot(lab, 0.1);
  EXPECT_NE(first.counts.counts, second.counts.counts);
  ASSERT_TRUE(lab.devices.gantry->home(lab.within(60)));
  EXPECT_EQ(shoot(lab, 0.1).counts.counts, first.counts.counts);
  lab.world->set_take(1);
  ASSERT_TRUE(lab.devices.gantry->home(lab.within(60)));
  EXPECT_NE(shoot(lab, 0.1).counts.counts, first.counts.counts);
}

TEST(World, ABracketAtOneLampPositionIsShadedOnce) {
  Lab lab(lab_rig());
  ASSERT_TRUE(lab.devices.gantry->home(lab.within(60)));
  shoot(lab, 0.1);  // dark: nothing to shade
  EXPECT_EQ(lab.world->renders(), 0);
  ASSERT_TRUE(lab.devices.lamp->set(0.5, lab.within(1)));
  go(lab, 0.3, 0.8, 10);
  for (const double exposure : {0.01, 0.04, 0.16}) shoot(lab, exposure);
  ASSERT_TRUE(lab.devices.lamp->set(0.9, lab.within(1)));
  shoot(lab, 0.04);
  EXPECT_EQ(lab.world->renders(), 1);
  go(lab, 0.4, 0.8, 10);
  shoot(lab, 0.04);
  EXPECT_EQ(lab.world->renders(), 2);
}

TEST(World, TheImageIsWhatTheSensorMakesOfTheClosedFormRadiance) {
  Rig rig = lab_rig();
  rig.simulation->ambient = Eigen::Array3d::Constant(0.3);
  rig.camera.sensor.read_noise = 0;
  Lab lab(rig);
  ASSERT_TRUE(lab.devices.gantry->home(lab.within(60)));
  // Ambient alone, far from the object: response · L · t + dark · t electrons.
  const Frame dark = shoot(lab, 0.5);
  const double background = 64 + (2000 * 0.3 + 2) * 0.5 / 2.5;
  EXPECT_NEAR(dark.counts.counts[0], background, 6 * std::sqrt(301.0) / 2.5);
  // Lit: the sphere's nearest point to the camera, under a lamp that stands beside the camera.
  ASSERT_TRUE(lab.devices.lamp->set(0.9, lab.within(1)));
  const double elevation = std::atan2(0.4, 0.6);
  go(lab, -std::numbers::pi / 2, elevation, 20);
  const Frame lit = shoot(lab, 0.05);
  const double distance = 0.5 - 0.05;
  const double radiance = 0.3 + 0.5 / std::numbers::pi * 2.0 * 0.9 / (distance * distance);
  const double electrons = (2000 * radiance + 2) * 0.05;
  double mean = 0;
  for (int row = 22; row < 26; ++row) {
    for (int column = 30; column < 34; ++column) {
      mean += lit.counts.counts[static_cast<std::size_t>(row * 64 + column)] / 16.0;
    }
  }
  EXPECT_NEAR(mean, 64 + electrons / 2.5,
              5 * std::sqrt(electrons) / 2.5 / 4 + 0.01 * electrons / 2.5);
}

TEST(World, ExposingBeforeTheArmHasSettledGivesAVisiblyWrongPicture) {
  Rig rig = lab_rig();
  rig.simulation->arm_frequency = 1.5;
  rig.simulation->arm_damping = 0.05;
  Lab lab(rig);
  ASSERT_TRUE(lab.devices.gantry->home(lab.within(60)));
  ASSERT_TRUE(lab.devices.lamp->set(0.9, lab.within(1)));
  go(lab, 1.2, 0.6, 0);
  shoot(lab, 0.05);
  go(lab, 1.2, 0.6, 60);
  shoot(lab, 0.05);
  const auto records = lab.world->records();
  ASSERT_EQ(records.size(), 2U);
  EXPECT_FALSE(records[0].moment.moving);  // the drives say they have arrived
  EXPECT_GT((records[0].moment.light.p - records[1].moment.light.p).norm(), 0.002);
  EXPECT_EQ(records[1].moment.light.p, light_at(rig.gantry.model, dome_position(1.2, 0.6)).p);
}

TEST(World, AnExposureDuringAMoveSeesTheLampWhereItIsAtMidExposure) {
  Rig rig = lab_rig();
  rig.simulation->arm_frequency = 0;
  Lab lab(rig);
  ASSERT_TRUE(lab.devices.gantry->home(lab.within(60)));
  const TimePoint start = lab.clock->now();
  ASSERT_TRUE(lab.world->start_move(dome_position(1.1, 1.2)));
  shoot(lab, 1.0);
  const ExposureRecord record = lab.world->records().back();
  EXPECT_TRUE(record.moment.moving);
  EXPECT_EQ(record.moment.time, start + 500ms);
  const GantryPosition expected =
      move_position(rig.gantry.model, dome_position(0.1, 0.2), dome_position(1.1, 1.2), 0.5);
  EXPECT_LT((record.moment.drives.axes - expected.axes).norm(), 1e-9);
}

TEST(World, TheLampPositionErrorHasItsSizeAndStaysWithThePosition) {
  Rig rig = lab_rig();
  rig.simulation->lamp_position_error = 0.003;
  for (const bool distant_lamp : {false, true}) {
    rig.gantry.model.distant_lamp = distant_lamp;
    Lab lab(rig);
    ASSERT_TRUE(lab.devices.gantry->home(lab.within(60)));
    double square = 0;
    const int count = 200;
    for (int i = 0; i < count; ++i) {
      const GantryPosition there = dome_position(0.01 * i, 0.3);
      go(lab, 0.01 * i, 0.3, 100);
      const Eigen::Vector3d real = lab.world->look().light.p;
      const double arm = distant_lamp ? 0.5 : 1.0;
      square += (arm * (real - light_at(rig.gantry.model, there).p)).squaredNorm() / count;
      lab.wait(50);
      EXPECT_EQ(lab.world->look().light.p, real);
    }
    // Three components near, the two across the direction for a distant lamp.
    const double expected = 0.003 * std::sqrt(distant_lamp ? 2.0 / 3 : 1.0);
    EXPECT_NEAR(std::sqrt(square), expected, 0.15 * expected);
  }
}

TEST(World, TheLampIsALeaseThatEndsDarkByItself) {
  Rig rig = lab_rig();
  rig.lamp.max_on_time = 5s;
  Lab lab(rig);
  ASSERT_TRUE(lab.devices.lamp->set(0.5, lab.within(1)));
  lab.wait(4.9);
  EXPECT_EQ(lab.world->lamp_power(), 0.5);
  ASSERT_TRUE(lab.devices.lamp->set(0.5, lab.within(1)));  // renewed
  lab.wait(4.9);
  EXPECT_EQ(lab.world->lamp_power(), 0.5);
  lab.wait(0.2);
  EXPECT_EQ(lab.world->lamp_power(), 0);
  EXPECT_EQ(lab.world->look().lamp_power, 0);
}

TEST(World, AnOpenedDoorHaltsTheMoveWithinItsBrakingDistanceAndForbidsTheNext) {
  Lab lab(lab_rig());
  ASSERT_TRUE(lab.devices.gantry->home(lab.within(60)));
  ASSERT_TRUE(lab.world->start_move(dome_position(2.5, 0.2)));
  lab.wait(1.5);
  const double at_opening = lab.world->gantry_status().position.axes[0];
  lab.world->set_interlock("door", true);
  lab.wait(5);
  const GantryStatus status = lab.world->gantry_status();
  EXPECT_TRUE(status.at_rest);
  EXPECT_EQ(status.open_interlocks, std::vector<std::string>{"door"});
  EXPECT_NEAR(status.position.axes[0] - at_opening, 0.8 * 0.8 / (2 * 1.6), 1e-6);
  const auto refused = lab.devices.gantry->move_to(dome_position(0, 0.2), lab.within(60));
  ASSERT_FALSE(refused);
  EXPECT_EQ(refused.error().code, ErrorCode::refused);
  EXPECT_NE(refused.error().message.find("door"), std::string::npos);
  EXPECT_FALSE(lab.devices.gantry->clear_fault(lab.within(1)));
  lab.world->set_interlock("door", false);
  EXPECT_TRUE(lab.devices.gantry->clear_fault(lab.within(1)));
  EXPECT_TRUE(lab.devices.gantry->move_to(dome_position(0, 0.2), lab.within(60)));
}

TEST(World, TellsWhenAMovingGantryWasToldToStop) {
  Lab lab(lab_rig());
  lab.world->halt_gantry();
  EXPECT_TRUE(lab.world->halts().empty()) << "it was at rest";
  ASSERT_TRUE(lab.devices.gantry->home(lab.within(60)));
  ASSERT_TRUE(lab.world->start_move(dome_position(2.5, 0.2)));
  lab.wait(1.5);
  lab.world->halt_gantry();
  ASSERT_EQ(lab.world->halts().size(), 1U);
  lab.wait(5);
  lab.world->halt_gantry();
  EXPECT_EQ(lab.world->halts().size(), 1U);
}

TEST(World, AnAlarmStandsUntilItIsCleared) {
  Lab lab(lab_rig());
  ASSERT_TRUE(lab.devices.gantry->home(lab.within(60)));
  lab.world->raise_alarm("0x30 overload");
  const auto refused = lab.devices.gantry->move_to(dome_position(0, 0.2), lab.within(60));
  ASSERT_FALSE(refused);
  EXPECT_NE(refused.error().message.find("0x30 overload"), std::string::npos);
  EXPECT_EQ(lab.world->gantry_status().alarm, "0x30 overload");
  ASSERT_TRUE(lab.devices.gantry->clear_fault(lab.within(1)));
  EXPECT_TRUE(lab.devices.gantry->move_to(dome_position(0, 0.2), lab.within(60)));
}

TEST(World, AHalvedExposureHalvesTheSignal) {
  Rig rig = lab_rig();
  rig.camera.sensor.dark_current = 0;
  Lab lab(rig);
  ASSERT_TRUE(lab.devices.gantry->home(lab.within(60)));
  ASSERT_TRUE(lab.devices.lamp->set(0.9, lab.within(1)));
  go(lab, -1.2, 0.7, 20);
  const double black = 64.0 * 64 * 48;
  const double whole = total(shoot(lab, 0.08)) - black, half = total(shoot(lab, 0.04)) - black;
  EXPECT_GT(half, 10000);
  EXPECT_NEAR(half / whole, 0.5, 0.01);
}

/// A clock that stands still and tells once, when asked the time, that it was asked.
class TellTaleClock final : public Clock {
 public:
  TimePoint now() const override {
    if (armed_.exchange(false)) asked_.release();
    return TimePoint(std::chrono::nanoseconds(time_.load()));
  }
  void sleep_until(TimePoint, const std::stop_token&) override {}
  void advance(std::chrono::nanoseconds by) { time_ += by.count(); }
  void arm() { armed_ = true; }
  void wait_until_asked() { asked_.acquire(); }

 private:
  std::atomic<std::int64_t> time_ = 0;
  mutable std::atomic<bool> armed_ = false;
  mutable std::binary_semaphore asked_{0};
};

// A more urgent thread on the same processor asks for a move while the halt holds the laboratory:
// it gets its turn the moment the halt lets go. On a clock that stands still what halts has not
// moved.
TEST(World, NoMoveSlipsBetweenTheHaltAndTheOpenDoorOrTheAlarm) {
  cpu_set_t one;
  CPU_ZERO(&one);
  CPU_SET(static_cast<unsigned>(sched_getcpu()), &one);
  TellTaleClock clock;
  RenderOptions options;
  options.threads = 1;
  World world(lab_rig(), make_sphere(0.05, 2), lambert(0.5), clock, 1, options);
  ASSERT_TRUE(world.start_homing());
  clock.advance(100s);
  for (const bool door : {true, false}) {
    std::atomic<int> urgent = -1;
    std::binary_semaphore ready{0};
    std::jthread mover([&] {
      const sched_param priority{.sched_priority = 1};
      urgent = pthread_setaffinity_np(pthread_self(), sizeof one, &one) == 0 &&
               pthread_setschedparam(pthread_self(), SCHED_FIFO, &priority) == 0;
      ready.release();
      clock.wait_until_asked();
      static_cast<void>(world.start_move(dome_position(1, 1)));
    });
    ready.acquire();
    clock.arm();
    if (urgent != 1) static_cast<void>(clock.now());  // lets the mover go
    if (urgent != 1) GTEST_SKIP() << "a thread of real-time priority needs root";
    ASSERT_EQ(pthread_setaffinity_np(pthread_self(), sizeof one, &one), 0);
    door ? world.set_interlock("door", true) : world.raise_alarm("overload");
    mover.join();
    EXPECT_TRUE(world.gantry_status().at_rest) << (door ? "the door" : "the alarm");
    world.set_interlock("door", false);
    ASSERT_TRUE(world.clear_fault());
  }
}

TEST(World, ARigWithoutSimulationIsABrokenPromiseAndNotALookAtNothing) {
  Rig rig = lab_rig();
  rig.simulation.reset();
  EXPECT_DEATH(Lab lab(rig), "simulation");
}

}  // namespace
}  // namespace lightrig::sim
