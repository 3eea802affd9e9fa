#include "daemon/session/alongside.h"

#include <gtest/gtest.h>
#include <sys/resource.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <filesystem>
#include <string>
#include <thread>
#include <vector>

#include "tests/session/scene.h"
#include "tests/session/scratch.h"

namespace lightrig {
namespace {

// A reduction that never comes, and so stands for one that takes long: its thread is not started.
TEST(Alongside, TellsThatItWaitsUntilToldToStop) {
  const Scratch scratch;
  const Rig rig = small_rig(scratch.path());
  const SessionSpec spec = spec_of(rig);
  Alongside alongside(rig, spec, small_plan(), {scratch.path()});
  CapturedShot shot;
  shot.name = "L00";
  alongside.add(shot);
  int beats = 0;
  const auto twice = [&](std::stop_source stop) {
    beats = 0;
    return Patience{stop.get_token(), [&beats, stop]() mutable {
                      if (++beats == 2) stop.request_stop();
                    }};
  };
  EXPECT_FALSE(alongside.wait_for_all(twice({})));
  EXPECT_EQ(beats, 2);
  EXPECT_FALSE(alongside.wait_for_pose("L00", twice({})));
  EXPECT_EQ(beats, 2);
  EXPECT_FALSE(alongside.replan({}, twice({})));
  EXPECT_EQ(beats, 2);
}

/// Nice values of this process's threads but the caller's.
std::vector<int> nice_of_others() {
  std::vector<int> values;
  for (const auto& task : std::filesystem::directory_iterator("/proc/self/task")) {
    const auto tid = static_cast<id_t>(std::stol(task.path().filename().string()));
    if (tid != static_cast<id_t>(::gettid())) values.push_back(::getpriority(PRIO_PROCESS, tid));
  }
  return values;
}

bool one_has_nice(int value) { return std::ranges::count(nice_of_others(), value) > 0; }

/// Whether this process may make a thread of its own hurry again.
bool may_raise() {
  bool raised = false;
  std::jthread([&] {
    const auto tid = static_cast<id_t>(::gettid());
    const int own = ::getpriority(PRIO_PROCESS, tid);
    raised = ::setpriority(PRIO_PROCESS, tid, own + 1) == 0 &&
             ::setpriority(PRIO_PROCESS, tid, own) == 0;
  }).join();
  return raised;
}

// Beside other work a session would wait for all of that.
TEST(Alongside, LendsItsThreadThePriorityOfWhoWaits) {
  const Scratch scratch;
  const Rig rig = small_rig(scratch.path());
  const SessionSpec spec = spec_of(rig);
  const int own = ::getpriority(PRIO_PROCESS, static_cast<id_t>(::gettid()));
  ASSERT_LT(own, 10) << "run it with the usual priority";
  Alongside alongside(rig, spec, small_plan(), {scratch.path()});
  alongside.start({}, true);
  while (!one_has_nice(10)) std::this_thread::sleep_for(std::chrono::milliseconds(1));  // it runs
  // Nobody adds a shot, so that who asks for the pose waits.
  std::stop_source stop;
  bool low_while_waiting = true;
  EXPECT_FALSE(alongside.wait_for_pose("L00", {stop.get_token(), [&] {
                                                 low_while_waiting = one_has_nice(10);
                                                 stop.request_stop();
                                               }}));
  EXPECT_EQ(low_while_waiting, !may_raise());
  EXPECT_TRUE(one_has_nice(10));
}

}  // namespace
}  // namespace lightrig
