// When a condition pauses a session and when it lets it go on: every state with every reading.
#include "daemon/session/pause_rules.h"

#include <gtest/gtest.h>

#include <limits>
#include <map>
#include <utility>

namespace lightrig {
namespace {

enum class Reading : std::uint8_t { low, at_lower, between, at_upper, high, not_a_number };
constexpr std::array all_readings{Reading::low,      Reading::at_lower, Reading::between,
                                  Reading::at_upper, Reading::high,     Reading::not_a_number};
constexpr std::array all_holds{Hold::none, Hold::held};

constexpr PauseRule by_person{.pause_above = 60, .resume_below = 50, .resume_by_itself = false};
constexpr PauseRule by_itself{.pause_above = 60, .resume_below = 50, .resume_by_itself = true};

double value(Reading reading) {
  switch (reading) {
    case Reading::low:
      return 20;
    case Reading::at_lower:
      return 50;
    case Reading::between:
      return 55;
    case Reading::at_upper:
      return 60;
    case Reading::high:
      return 61;
    case Reading::not_a_number:
      break;
  }
  return std::numeric_limits<double>::quiet_NaN();
}

// Written down apart from the function.
const std::map<std::pair<Hold, Reading>, Hold> table{
    {{Hold::none, Reading::low}, Hold::none},     {{Hold::none, Reading::at_lower}, Hold::none},
    {{Hold::none, Reading::between}, Hold::none}, {{Hold::none, Reading::at_upper}, Hold::none},
    {{Hold::none, Reading::high}, Hold::held},    {{Hold::none, Reading::not_a_number}, Hold::held},
    {{Hold::held, Reading::low}, Hold::none},     {{Hold::held, Reading::at_lower}, Hold::none},
    {{Hold::held, Reading::between}, Hold::held}, {{Hold::held, Reading::at_upper}, Hold::held},
    {{Hold::held, Reading::high}, Hold::held},    {{Hold::held, Reading::not_a_number}, Hold::held},
};

TEST(PauseRule, HoldsAndReleasesEveryPairAsTheTableSays) {
  for (const Hold state : all_holds) {
    for (const Reading reading : all_readings) {
      EXPECT_EQ(next(state, by_itself, value(reading)), table.at({state, reading}))
          << static_cast<int>(state) << " with " << value(reading);
    }
  }
}

TEST(PauseRule, LetsASessionGoOnByItselfOnlyWhereTheRigFileSaysSoAndBelowTheLowerBound) {
  for (const Reading reading : all_readings) {
    EXPECT_FALSE(may_go_on(by_person, value(reading), false)) << value(reading);
    EXPECT_EQ(may_go_on(by_itself, value(reading), false),
              reading == Reading::low || reading == Reading::at_lower)
        << value(reading);
  }
}

TEST(PauseRule, TakesAPersonsWordWheneverTheReadingIsNotAboveTheUpperBound) {
  for (const PauseRule& rule : {by_person, by_itself}) {
    for (const Reading reading : all_readings) {
      EXPECT_EQ(may_go_on(rule, value(reading), true),
                reading != Reading::high && reading != Reading::not_a_number)
          << value(reading);
    }
  }
}

CameraCounters counters(std::uint64_t resent, std::uint64_t lost) {
  CameraCounters now;
  now.packets_resent = resent;
  now.packets_lost = lost;
  return now;
}

TEST(PacketWindow, CountsWhatIsLostOrRepeatedFromFrameToFrameOverTheLastFewFrames) {
  PacketWindow window(3);
  window.begin(counters(100, 7));  // of other sessions
  EXPECT_EQ(window.per_frame(), 0);
  window.add(counters(103, 7));
  EXPECT_DOUBLE_EQ(window.per_frame(), 3);
  window.add(counters(103, 8));
  EXPECT_DOUBLE_EQ(window.per_frame(), 2);
  EXPECT_FALSE(window.full());
  window.add(counters(103, 8));
  EXPECT_TRUE(window.full());
  EXPECT_DOUBLE_EQ(window.per_frame(), 4.0 / 3);
  window.add(counters(103, 8));  // the three go out of sight
  EXPECT_DOUBLE_EQ(window.per_frame(), 1.0 / 3);
  window.forget();
  EXPECT_FALSE(window.full());
  EXPECT_EQ(window.per_frame(), 0);
}

TEST(PacketWindow, TakesCountersThatFellForThoseOfACameraOpenedAnew) {
  PacketWindow window(2);
  window.begin(counters(50, 50));
  window.add(counters(1, 1));
  EXPECT_DOUBLE_EQ(window.per_frame(), 2);
}

}  // namespace
}  // namespace lightrig
