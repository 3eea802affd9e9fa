// The promise that the watchdog feeds on: kept by what gets done, not by time passing.
#include "daemon/service/liveness.h"

#include <gtest/gtest.h>

#include <atomic>
#include <filesystem>
#include <limits>
#include <map>
#include <thread>

#include "daemon/service/service.h"
#include "tests/service/scratch_folder.h"
#include "tests/service/small_rig.h"

namespace lightrig {
namespace {

using namespace std::chrono_literals;
using SteadyClock = std::chrono::steady_clock;

TEST(Liveness, HoldsAsLongAsWasPromisedAndNoLonger) {
  SteadyClock::time_point now{};
  Liveness liveness([&now] { return now; });
  EXPECT_TRUE(liveness.holds()) << "nothing is promised yet";
  liveness.promise(5min);
  now += 5min;
  EXPECT_TRUE(liveness.holds());
  now += 1ms;
  EXPECT_FALSE(liveness.holds());
  liveness.promise(1min);
  EXPECT_TRUE(liveness.holds()) << "it was heard of again";
}

// On a clock that stands still: a plan or a reduction that hangs is told within minutes, since it
// never promises more, and one that works says so again and again.
TEST(Liveness, OfAComputationIsPromisedForMinutesAndRenewedByWhatItGetsDone) {
  ScratchFolder folder;
  std::atomic<int> promises{0};
  const SteadyClock::time_point now = SteadyClock::now();
  Liveness liveness([&] {
    ++promises;
    return now;
  });
  const Rig rig = small_rig(folder.path());
  std::filesystem::create_directories(rig.session_root);
  EventHub hub;
  const Log log{LogLevel::warning, Log::Sink::none};
  Service service({rig, true, std::numeric_limits<double>::infinity(), 2}, log, hub, liveness);
  const auto wait_until = [&](const auto& so) {
    const auto end = SteadyClock::now() + 280s;  // minutes under a sanitizer
    while (!so() && SteadyClock::now() < end) std::this_thread::sleep_for(1ms);
    return so();
  };
  ASSERT_TRUE(service.arm({"test", ""}));
  ASSERT_TRUE(wait_until([&] { return service.snapshot().state == State::armed; }));
  struct Seen {
    int first = 0, last = 0;
  };
  std::map<State, Seen> seen;
  auto spec = read_session("", service.rig());
  ASSERT_TRUE(spec.value);
  ASSERT_TRUE(service.start({"test", ""}, {std::move(*spec.value), {}, ""}));
  ASSERT_TRUE(wait_until([&] {
    const int count = promises;
    const State before = service.snapshot().state;
    const bool too_long = liveness.holds(now + 6min);
    const State after = service.snapshot().state;
    if (before == after && (after == State::planning || after == State::reducing)) {
      EXPECT_FALSE(too_long) << name_of(after);
      Seen& one = seen[after];
      if (one.first == 0) one.first = count;
      one.last = count;
    }
    return after == State::done || after == State::armed;  // refused: there is nothing to wait for
  }));
  EXPECT_EQ(service.snapshot().state, State::done);
  // Stages of a plan; frames, merges, fits and pictures of five lights.
  EXPECT_GE(seen[State::planning].last - seen[State::planning].first, 3);
  EXPECT_GE(seen[State::reducing].last - seen[State::reducing].first, 20);
}

}  // namespace
}  // namespace lightrig
