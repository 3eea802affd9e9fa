#include "daemon/service/state.h"

#include <gtest/gtest.h>

#include <map>
#include <utility>

namespace lightrig {
namespace {

using S = State;
using E = Event;

// The machine as a table, written down apart from the function: every pair that is not here is
// illegal.
const std::map<std::pair<S, E>, S> legal{
    {{S::unarmed, E::arm}, S::armed},          {{S::unarmed, E::abort}, S::unarmed},
    {{S::unarmed, E::fault}, S::faulted},

    {{S::armed, E::disarm}, S::unarmed},       {{S::armed, E::abort}, S::unarmed},
    {{S::armed, E::home}, S::homing},          {{S::armed, E::start}, S::planning},
    {{S::armed, E::fault}, S::faulted},

    {{S::homing, E::homed}, S::armed},         {{S::homing, E::abort}, S::aborted},
    {{S::homing, E::fault}, S::faulted},       {{S::homing, E::halted}, S::unarmed},

    {{S::planning, E::planned}, S::capturing}, {{S::planning, E::refused}, S::armed},
    {{S::planning, E::abort}, S::aborted},     {{S::planning, E::fault}, S::faulted},
    {{S::planning, E::captured}, S::reducing}, {{S::planning, E::halted}, S::armed},

    {{S::capturing, E::pause}, S::paused},     {{S::capturing, E::captured}, S::reducing},
    {{S::capturing, E::abort}, S::aborted},    {{S::capturing, E::fault}, S::faulted},
    {{S::capturing, E::halted}, S::paused},

    {{S::paused, E::resume}, S::capturing},    {{S::paused, E::captured}, S::reducing},
    {{S::paused, E::abort}, S::aborted},       {{S::paused, E::fault}, S::faulted},
    {{S::paused, E::halted}, S::paused},

    {{S::reducing, E::reduced}, S::done},      {{S::reducing, E::refused}, S::armed},
    {{S::reducing, E::abort}, S::aborted},     {{S::reducing, E::fault}, S::faulted},
    {{S::reducing, E::pause}, S::paused},

    {{S::done, E::disarm}, S::unarmed},        {{S::done, E::abort}, S::unarmed},
    {{S::done, E::home}, S::homing},           {{S::done, E::start}, S::planning},
    {{S::done, E::clear}, S::armed},           {{S::done, E::fault}, S::faulted},

    {{S::aborted, E::arm}, S::armed},          {{S::aborted, E::clear}, S::unarmed},
    {{S::aborted, E::abort}, S::aborted},      {{S::aborted, E::fault}, S::faulted},

    {{S::faulted, E::clear}, S::unarmed},      {{S::faulted, E::abort}, S::faulted},
    {{S::faulted, E::fault}, S::faulted},
};

TEST(StateMachine, AnswersEveryPairAsTheTableSays) {
  for (S state : all_states)
    for (E event : all_events) {
      const auto row = legal.find({state, event});
      const auto after = next(state, event);
      EXPECT_EQ(after.has_value(), row != legal.end()) << name_of(state) << " + " << name_of(event);
      if (after && row != legal.end()) {
        EXPECT_EQ(*after, row->second)
            << name_of(state) << " + " << name_of(event) << " gave " << name_of(*after);
      }
    }
}

TEST(StateMachine, AcceptsAbortAndFaultInEveryState) {
  for (S state : all_states) {
    EXPECT_TRUE(next(state, E::abort)) << name_of(state);
    EXPECT_TRUE(next(state, E::fault)) << name_of(state);
  }
}

TEST(StateMachine, NeverStaysArmedAfterAbortOrFault) {
  for (S state : all_states) {
    EXPECT_FALSE(is_armed(*next(state, E::abort))) << name_of(state);
    EXPECT_FALSE(is_armed(*next(state, E::fault))) << name_of(state);
  }
}

// What the program itself does may not put aside what a person has yet to look at.
TEST(StateMachine, LeavesAnAbortOrAFaultByAPersonsWordAlone) {
  for (S state : {S::aborted, S::faulted})
    for (E event : all_events) {
      const auto after = next(state, event);
      if (after && *after != S::aborted && *after != S::faulted) {
        EXPECT_TRUE(event == E::clear || event == E::arm) << name_of(state) << name_of(event);
      }
    }
}

TEST(StateMachine, BecomesArmedFromAnUnarmedStateByArmingAlone) {
  for (S state : all_states) {
    if (is_armed(state)) continue;
    for (E event : all_events) {
      const auto after = next(state, event);
      if (after && is_armed(*after)) {
        EXPECT_EQ(event, E::arm) << name_of(state);
      }
    }
  }
}

TEST(StateMachine, StartsASessionOnlyWhereNoneIsUnderWay) {
  for (S state : all_states)
    EXPECT_EQ(next(state, E::start).has_value(), state == S::armed || state == S::done)
        << name_of(state);
}

TEST(StateMachine, NamesEveryStateAndEventDifferently) {
  std::map<std::string_view, int> seen;
  for (S state : all_states) ++seen[name_of(state)];
  for (E event : all_events) ++seen[name_of(event)];
  for (const auto& [name, count] : seen) EXPECT_EQ(count, 1) << name;
}

}  // namespace
}  // namespace lightrig
