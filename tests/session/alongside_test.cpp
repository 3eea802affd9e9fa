#include "daemon/session/alongside.h"

#include <gtest/gtest.h>

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

}  // namespace
}  // namespace lightrig
