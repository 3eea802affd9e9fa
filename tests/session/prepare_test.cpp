// What planning composes: candidates, held-out lights, bases, and what it says when a scene gives
// it nothing to plan.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <set>

#include "daemon/session/capture_time.h"
#include "daemon/session/lay_candidates.h"
#include "daemon/session/plan_json.h"
#include "daemon/session/plan_shots.h"
#include "tests/session/scene.h"
#include "tests/session/scratch.h"

namespace lightrig {
namespace {

using testing::HasSubstr;
constexpr double degree = std::numbers::pi / 180;

TEST(FibonacciSphere, CoversTheSphereEvenly) {
  const auto points = fibonacci_sphere(1000);
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  double least = 4;
  for (std::size_t i = 0; i < points.size(); ++i) {
    EXPECT_NEAR(points[i].norm(), 1, 1e-12);
    sum += points[i];
    for (std::size_t j = 0; j < i; ++j) least = std::min(least, (points[i] - points[j]).norm());
  }
  EXPECT_LT(sum.norm() / 1000, 1e-3);
  // The densest packing of 1,000 points has neighbours √(8π/(√3·1000)) = 0.120 apart; the spiral
  // is known to reach more than three quarters of it.
  EXPECT_GT(least, 0.75 * 0.120);
}

TEST(LayCandidates, LeavesOutWhatIsOutOfReachKeptOutOrInThePicture) {
  const Scratch scratch;
  const Rig plain = small_rig(scratch.path());
  const CandidateLayout layout = lay_candidates(plain);
  EXPECT_EQ(layout.offered, 120);
  EXPECT_EQ(layout.offered, static_cast<int>(layout.unusable.size() + layout.candidates.size()));
  // Elevations below 5° are out of travel: (1 + sin 5°)/2 of the sphere's area, and some of what
  // lies beyond 170° of azimuth and 88° of elevation.
  EXPECT_NEAR(layout.count(NotUsable::unreachable), 120 * 0.5436, 6);
  for (const Candidate& candidate : layout.candidates) {
    EXPECT_NEAR(candidate.light.p.norm(), 0.8, 1e-9);
    EXPECT_TRUE(within_limits(plain.gantry.model, candidate.gantry));
  }
  Rig boxed = plain;
  boxed.keep_out.push_back(KeepOutBox{"left half", {-2, -2, -2}, {0, 2, 2}});
  const CandidateLayout half = lay_candidates(boxed);
  EXPECT_GT(half.count(NotUsable::kept_out), layout.count(NotUsable::kept_out) + 15);
  for (const Candidate& candidate : half.candidates) EXPECT_GT(candidate.light.p.x(), 0);
  // A camera that looks straight up at the dome has lamps in its picture.
  Rig upward = plain;
  upward.camera.model.camera_from_world = look_at({0, 0, -1}, {0, 0, 0}, Eigen::Vector3d::UnitY());
  upward.camera.model.fx = upward.camera.model.fy = 30;
  EXPECT_GT(lay_candidates(upward).count(NotUsable::in_view), layout.count(NotUsable::in_view));
}

TEST(ClearWay, GoesRoundAKeepOutVolumeOrSaysThatItCannot) {
  const Scratch scratch;
  Rig rig = small_rig(scratch.path());
  const std::vector<Candidate> candidates = lay_candidates(rig).candidates;
  GantryPosition from, to;
  from.axes = Eigen::Vector2d(-40 * degree, 30 * degree);
  to.axes = Eigen::Vector2d(40 * degree, 30 * degree);
  ASSERT_EQ(clear_way(rig, candidates, from, to).value().size(), 1U);
  rig.keep_out.push_back(
      KeepOutSphere{"stand", 0.8 * Eigen::Vector3d(std::cos(0.5236), 0, std::sin(0.5236)), 0.1});
  EXPECT_EQ(obstacle_on_the_way(rig, from, to), "stand");
  const auto way = clear_way(rig, candidates, from, to);
  ASSERT_TRUE(way) << way.error().message;
  ASSERT_EQ(way->size(), 2U);
  EXPECT_EQ(obstacle_on_the_way(rig, from, way->front()), "");
  EXPECT_EQ(obstacle_on_the_way(rig, way->front(), to), "");
  rig.keep_out.push_back(KeepOutBox{"wall", {0, -0.05, -1}, {2, 0.05, 2}});
  const auto none = clear_way(rig, {}, from, to);
  ASSERT_FALSE(none);
  EXPECT_EQ(none.error().code, ErrorCode::refused);
  EXPECT_THAT(none.error().message, HasSubstr("stand"));
}

TEST(Prepare, HoldsOutALightThatIsNotPlannedAndNotBesideOneThatIs) {
  const Plan& plan = small_plan().plan;
  ASSERT_EQ(plan.shots.size(), 4U);
  EXPECT_TRUE(plan.shots.back().held_out);
  std::set<int> candidates;
  for (const Shot& shot : plan.shots) candidates.insert(shot.candidate);
  EXPECT_EQ(candidates.size(), 4U);
  const Eigen::Vector3d held_out = plan.shots.back().light.p.normalized();
  for (int i = 0; i < 3; ++i) {
    const Eigen::Vector3d other = plan.shots[static_cast<std::size_t>(i)].light.p.normalized();
    EXPECT_GT(std::acos(held_out.dot(other)), 8 * degree);
  }
  EXPECT_THAT(plan.visit_order, testing::UnorderedElementsAre(0, 1, 2, 3));
  EXPECT_GT(plan.predicted_capture_time, 4 * (0.8 + 5));  // settling and warming alone
}

TEST(Prepare, ChoosesTheSameLightsWithoutAnyShortcut) {
  const Scratch scratch;
  const Rig rig = small_rig(scratch.path());
  const auto plain = prepare(rig, spec_of(rig), true);
  ASSERT_TRUE(plain) << plain.error().message;
  const Plan &a = small_plan().plan, &b = plain->plan;
  ASSERT_EQ(a.shots.size(), b.shots.size());
  for (std::size_t i = 0; i < a.shots.size(); ++i) {
    EXPECT_EQ(a.shots[i].candidate, b.shots[i].candidate);
  }
}

TEST(Prepare, EndsAtItsNextStageOnceItIsToldToStop) {
  const Scratch scratch;
  const Rig rig = small_rig(scratch.path());
  std::stop_source stop;
  stop.request_stop();
  const auto prepared = prepare(rig, spec_of(rig), false, stop.get_token());
  ASSERT_FALSE(prepared);
  EXPECT_EQ(prepared.error().code, ErrorCode::stopped);
}

TEST(Prepare, PredictsTheErrorAfterEveryStepOfTheWay) {
  const Prepared& prepared = small_plan();
  const Plan& plan = prepared.plan;
  const std::vector<double> percent = predicted_on_the_way(prepared);
  ASSERT_EQ(percent.size(), plan.visit_order.size());
  double before = plan.mean_only_error_percent;
  for (std::size_t i = 0; i < percent.size(); ++i) {
    const Shot& shot = plan.shots[static_cast<std::size_t>(plan.visit_order[i])];
    if (shot.held_out)
      EXPECT_EQ(percent[i], before);
    else
      EXPECT_LT(percent[i], before);
    before = percent[i];
  }
  // At its end all lights are there, whatever the order they were chosen in.
  double least = plan.mean_only_error_percent;
  for (const Shot& shot : plan.shots)
    if (!shot.held_out) least = std::min(least, shot.selection.predicted_error_percent);
  EXPECT_NEAR(percent.back(), least, 1e-9 * least);
}

TEST(Prepare, AStoredPlanIsTakenAsItIsAndRefusedOnAnotherRig) {
  const Scratch scratch;
  const Rig rig = small_rig(scratch.path());
  const auto stored = plan_from_json(plan_to_json(rig, spec_of(rig), small_plan()));
  ASSERT_TRUE(stored) << stored.error().message;
  const auto again = prepare_with_plan(rig, spec_of(rig), *stored);
  ASSERT_TRUE(again) << again.error().message;
  EXPECT_EQ(again->plan.visit_order, small_plan().plan.visit_order);
  EXPECT_EQ(again->bins.cell, small_plan().bins.cell);
  const Rig other = small_rig(scratch.path(), {{"count = 120", "count = 121"}});
  const auto refused = prepare_with_plan(other, spec_of(other), *stored);
  ASSERT_FALSE(refused);
  EXPECT_THAT(refused.error().message, HasSubstr("plan again"));
}

TEST(Prepare, APlanChangedByHandIsRefusedBeforeAnythingMoves) {
  const Scratch scratch;
  const Rig rig = small_rig(scratch.path());
  const auto stored = plan_from_json(plan_to_json(rig, spec_of(rig), small_plan()));
  ASSERT_TRUE(stored) << stored.error().message;
  Plan elsewhere = *stored, longer = *stored;
  std::swap(elsewhere.shots[0].gantry, elsewhere.shots[1].gantry);
  longer.shots[0].exposures.back() *= 1e9;
  const auto moved = prepare_with_plan(rig, spec_of(rig), elsewhere);
  ASSERT_FALSE(moved);
  EXPECT_THAT(moved.error().message, HasSubstr("gantry_axes"));
  const auto waiting = prepare_with_plan(rig, spec_of(rig), longer);
  ASSERT_FALSE(waiting);
  EXPECT_THAT(waiting.error().message, HasSubstr("[bracket] does not offer"));
}

TEST(Prepare, APlanForAnotherObjectOrOtherMaterialsIsSaid) {
  const Scratch scratch;
  const Rig rig = small_rig(scratch.path());
  const auto stored = plan_from_json(plan_to_json(rig, spec_of(rig), small_plan()));
  ASSERT_TRUE(stored) << stored.error().message;
  const auto same = check_made_for(*stored, small_plan());
  EXPECT_TRUE(same) << same.error().message;
  Prepared other = small_plan();
  other.object.mesh.vertices *= 1.1;
  EXPECT_THAT(check_made_for(*stored, other).error().message, HasSubstr("another object"));
  other.materials.pop_back();
  EXPECT_THAT(check_made_for(*stored, other).error().message, HasSubstr("and other materials"));
}

TEST(Prepare, TheConditionNumberIsTakenOverTheComponentsThatMatter) {
  const Scratch scratch;
  const Rig rig = small_rig(scratch.path(), {{"a-optimal", "condition"}});
  const auto prepared = prepare(rig, spec_of(rig));
  ASSERT_TRUE(prepared) << prepared.error().message;
  const Eigen::VectorXd& s = prepared->fit_basis.stddev;
  const Eigen::Index k = prepared->plan_basis.components();
  EXPECT_LE(k, 45);
  EXPECT_LT(k, prepared->fit_basis.components());
  if (k < 45) {
    EXPECT_GE(s.head(k).squaredNorm(), 0.9989 * s.squaredNorm());
  }
  EXPECT_LT(s.head(k - 1).squaredNorm(), 0.9989 * s.squaredNorm());
  EXPECT_EQ(prepared->plan.left_out.components_used, k);
}

TEST(Prepare, AnObjectTheCameraCannotSeeIsSaidWithWhereItIs) {
  const Scratch scratch;
  const Rig rig = small_rig(scratch.path(), {{"target_m = [0.0, 0.0, 0.0]",  //
                                              "target_m = [0.0, -2.0, 0.45]"}});
  const auto prepared = prepare(rig, spec_of(rig));
  ASSERT_FALSE(prepared);
  EXPECT_EQ(prepared.error().code, ErrorCode::invalid_input);
  EXPECT_THAT(prepared.error().message, HasSubstr("the camera sees no point"));
  EXPECT_THAT(prepared.error().message, HasSubstr("[camera]"));
  EXPECT_THAT(prepared.error().message, HasSubstr("lies behind the camera"));
}

TEST(Prepare, APlaneSeenFromBehindIsSaidToBe) {
  const Scratch scratch;
  const Rig rig = small_rig(scratch.path());
  SessionSpec spec = spec_of(rig);
  spec.object.shape = "plane";
  spec.object.world_from_object.rotate(
      Eigen::AngleAxisd(std::numbers::pi, Eigen::Vector3d::UnitX()));
  const auto prepared = prepare(rig, spec);
  ASSERT_FALSE(prepared);
  EXPECT_EQ(prepared.error().code, ErrorCode::invalid_input);
  EXPECT_THAT(prepared.error().message, HasSubstr("sees its back"));
  EXPECT_THAT(prepared.error().message, HasSubstr("rotation_deg"));
}

TEST(Prepare, ALampThatCanLightNothingIsSaidWithTheCounts) {
  const Scratch scratch;
  Rig rig = small_rig(scratch.path());
  rig.keep_out.push_back(KeepOutBox{"everywhere", {-2, -2, -2}, {2, 2, 2}});
  const auto prepared = prepare(rig, spec_of(rig));
  ASSERT_FALSE(prepared);
  EXPECT_EQ(prepared.error().code, ErrorCode::invalid_input);
  EXPECT_THAT(prepared.error().message, HasSubstr("of 120 offered"));
}

}  // namespace
}  // namespace lightrig
