#include "sim/sim_clock.h"

#include <gtest/gtest.h>

#include <limits>
#include <thread>

namespace lightrig::sim {
namespace {

using namespace std::chrono_literals;
using std::chrono::steady_clock;

TEST(SimClock, AJumpingClockSleepsAWeekInNoTime) {
  const auto clock = make_clock(std::numeric_limits<double>::infinity());
  const auto started = steady_clock::now();
  const TimePoint start = clock->now();
  clock->sleep_until(start + 7 * 24h, {});
  EXPECT_EQ(clock->now(), start + 7 * 24h);
  clock->sleep_until(start + 1h, {});  // in the past: time never runs back
  EXPECT_EQ(clock->now(), start + 7 * 24h);
  EXPECT_LT(steady_clock::now() - started, 1s);
}

TEST(SimClock, AScaledClockRunsAtItsRateAndNeverWakesEarly) {
  const auto clock = make_clock(50);
  const auto started = steady_clock::now();
  const TimePoint target = clock->now() + 5s;
  clock->sleep_until(target, {});
  EXPECT_GE(clock->now(), target);
  const auto took = steady_clock::now() - started;
  EXPECT_GE(took, 99ms);
  EXPECT_LT(took, 2s);
}

TEST(SimClock, WorkBetweenSleepsTakesTheTimeItTakes) {
  const auto clock = make_clock(1000);
  const auto started = steady_clock::now();
  const TimePoint start = clock->now();
  std::this_thread::sleep_for(20ms);  // work, as far as the clock is concerned
  const auto worked = clock->now() - start;
  EXPECT_GE(worked, 20ms);
  EXPECT_LE(worked, steady_clock::now() - started);
  clock->sleep_until(start + 1h, {});
  const TimePoint woken = clock->now();
  EXPECT_GE(woken, start + 1h);
  EXPECT_LE(woken - start, 1h + (steady_clock::now() - started));
}

TEST(SimClock, TimeWaitsForASleeperThatWakesLate) {
  const auto clock = make_clock(1000);
  const auto started = steady_clock::now();
  const TimePoint start = clock->now();
  TimePoint first, second;
  {
    std::jthread early([&] {
      clock->sleep_until(start + 10s, {});
      first = clock->now();
    });
    std::jthread late([&] {
      clock->sleep_until(start + 20s, {});
      second = clock->now();
    });
  }
  EXPECT_GE(first, start + 10s);
  EXPECT_GE(second, start + 20s);
  // Beyond the last end, time runs no faster than really.
  EXPECT_LE(std::max(first, second), start + 20s + (steady_clock::now() - started));
}

TEST(SimClock, AStopRequestEndsEverySleepWithinTenMilliseconds) {
  for (const double rate : {1.0, 10.0}) {
    for (const auto length :
         {std::chrono::nanoseconds(100s), std::chrono::nanoseconds::max() / 2}) {
      const auto clock = make_clock(rate);
      std::stop_source source;
      steady_clock::time_point woke;
      std::jthread sleeper([&] {
        clock->sleep_until(TimePoint(clock->now().time_since_epoch() + length), source.get_token());
        woke = steady_clock::now();
      });
      std::this_thread::sleep_for(20ms);
      const auto asked = steady_clock::now();
      source.request_stop();
      sleeper.join();
      EXPECT_LT(woke - asked, 50ms);  // 10 ms, and slack for a loaded machine
    }
  }
}

TEST(SimClock, WaitingForeverOnAJumpingClockWaitsForTheStopAlone) {
  const auto clock = make_clock(std::numeric_limits<double>::infinity());
  const TimePoint start = clock->now();
  std::stop_source source;
  std::jthread sleeper([&] { clock->sleep_until(TimePoint::max(), source.get_token()); });
  std::this_thread::sleep_for(10ms);
  source.request_stop();
  sleeper.join();
  EXPECT_EQ(clock->now(), start);
}

}  // namespace
}  // namespace lightrig::sim
