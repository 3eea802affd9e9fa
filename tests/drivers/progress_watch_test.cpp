#include "drivers/progress_watch.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace lightrig {
namespace {

using namespace std::chrono_literals;
using testing::HasSubstr;

GantryModel two_axes() {
  GantryModel model;
  model.axes = {{"azimuth", true, -3, 3, 1, 1, 0, false}, {"slide", false, 0, 1, 1, 1, 0, false}};
  model.tolerance = 1e-3;
  model.linear_tolerance = 1e-4;
  return model;
}

GantryPosition at(double azimuth, double slide) {
  GantryPosition position;
  position.axes.resize(2);
  position.axes << azimuth, slide;
  return position;
}

TEST(ProgressWatch, LetsAMoveComeNearAndOvershootALittle) {
  const GantryModel model = two_axes();
  const TimePoint begun{};
  ProgressWatch watch(model, at(0, 0.5), at(1, 0.5), begun);
  for (int i = 0; i <= 100; ++i) EXPECT_TRUE(watch.see(at(0.01 * i, 0.5), begun + i * 100ms)) << i;
  EXPECT_TRUE(watch.see(at(1.02, 0.5), begun + 11s));
  EXPECT_TRUE(watch.see(at(1, 0.5), begun + 60s)) << "there it may rest as long as it likes";
}

TEST(ProgressWatch, SaysWhichAxisGoesTheWrongWay) {
  const GantryModel model = two_axes();
  ProgressWatch watch(model, at(0, 0.5), at(1, 0.6), TimePoint{});
  EXPECT_TRUE(watch.see(at(0.1, 0.497), TimePoint{} + 100ms)) << "within what a belt gives";
  const auto wrong = watch.see(at(0.2, 0.49), TimePoint{} + 200ms);
  ASSERT_FALSE(wrong);
  EXPECT_EQ(wrong.error().code, ErrorCode::refused);
  EXPECT_THAT(wrong.error().message, HasSubstr("axis slide goes away from its target"));
}

TEST(ProgressWatch, GivesUpWhereNothingComesNearer) {
  const GantryModel model = two_axes();
  ProgressWatch watch(model, at(0, 0.5), at(1, 0.5), TimePoint{}, 2s);
  EXPECT_TRUE(watch.see(at(0.5, 0.5), TimePoint{} + 1s));
  EXPECT_TRUE(watch.see(at(0.5005, 0.5), TimePoint{} + 2900ms)) << "less than the tolerance";
  const auto stalled = watch.see(at(0.5, 0.5), TimePoint{} + 3s);
  ASSERT_FALSE(stalled);
  EXPECT_EQ(stalled.error().code, ErrorCode::timed_out);
  EXPECT_THAT(stalled.error().message, HasSubstr("no axis has come nearer"));
}

}  // namespace
}  // namespace lightrig
