// What planning composes: candidates, held-out lights, bases, and what it says when a scene gives
// it nothing to plan.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <set>

#include "core/shapes.h"
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
  const auto way_of = [&](const std::vector<Candidate>& by, const GantryPosition& from,
                          const GantryPosition& to) {
    return clear_way(rig, obstacles_of(rig, nullptr), by, from, to);
  };
  const auto obstacle = [&](const GantryPosition& from, const GantryPosition& to) {
    return obstacle_on_the_way(rig, obstacles_of(rig, nullptr), from, to);
  };
  GantryPosition from, to;
  from.axes = Eigen::Vector2d(-40 * degree, 30 * degree);
  to.axes = Eigen::Vector2d(40 * degree, 30 * degree);
  ASSERT_EQ(way_of(candidates, from, to).value().size(), 1U);
  rig.keep_out.push_back(
      KeepOutSphere{"stand", 0.8 * Eigen::Vector3d(std::cos(0.5236), 0, std::sin(0.5236)), 0.1});
  EXPECT_EQ(obstacle(from, to), "stand");
  const auto way = way_of(candidates, from, to);
  ASSERT_TRUE(way) << way.error().message;
  ASSERT_EQ(way->size(), 2U);
  EXPECT_EQ(obstacle(from, way->front()), "");
  EXPECT_EQ(obstacle(way->front(), to), "");
  rig.keep_out.push_back(KeepOutBox{"wall", {0, -0.05, -1}, {2, 0.05, 2}});
  const auto none = way_of({}, from, to);
  ASSERT_FALSE(none);
  EXPECT_EQ(none.error().code, ErrorCode::refused);
  EXPECT_THAT(none.error().message, HasSubstr("stand"));
}

/// Two stops at 30° of elevation, 40° to either side of a stand that the object's mesh is.
struct AroundAStand {
  explicit AroundAStand(const Scratch& scratch) : rig(small_rig(scratch.path())) {
    rig.gantry.solid.emplace();
    rig.gantry.solid->body.lamp_radius = 0.02;
    stand = make_sphere(0.1, 3);
    const Eigen::Vector3d at = 0.8 * Eigen::Vector3d(std::cos(30 * degree), 0, 0.5);
    stand.vertices.colwise() += at;
    for (const double azimuth : {-40.0, 40.0}) {
      Shot shot;
      shot.gantry.axes = Eigen::Vector2d(azimuth * degree, 30 * degree);
      shot.exposures = {1e-3, 1e-2};
      plan.shots.push_back(shot);
    }
    plan.visit_order = {0, 1};
  }
  Rig rig;
  Mesh stand;
  Plan plan;
};

TEST(CaptureTime, GoesRoundTheObjectAsTheCaptureDoes) {
  const Scratch scratch;
  const AroundAStand scene(scratch);
  const SessionSpec spec = spec_of(scene.rig);
  const CaptureTime straight = capture_time(scene.rig, spec, scene.plan, nullptr);
  const CaptureTime round = capture_time(scene.rig, spec, scene.plan, &scene.stand);
  EXPECT_EQ(straight.shots[1].way.size(), 1U);
  ASSERT_EQ(round.shots[1].way.size(), 2U);
  EXPECT_GT(round.shots[1].move, straight.shots[1].move);
  const GantryModel& gantry = scene.rig.gantry.model;
  EXPECT_DOUBLE_EQ(round.shots[1].move,
                   move_time(gantry, scene.plan.shots[0].gantry, round.shots[1].way[0]) +
                       move_time(gantry, round.shots[1].way[0], scene.plan.shots[1].gantry));
  // Home is at 10° of elevation, and the way round leaves the 30° of both stops.
  const double by_the_way = round.shots[1].way[0].axes[1];
  const std::vector<AxisRange> ranges = axis_ranges(gantry, round);
  EXPECT_NEAR(ranges[0].least, -40 * degree, 1e-12);
  EXPECT_NEAR(ranges[1].least, std::min(10 * degree, by_the_way), 1e-12);
  EXPECT_NEAR(ranges[1].most, std::max(30 * degree, by_the_way), 1e-12);
}

TEST(CaptureTime, IsGivenForEveryNumberOfLights) {
  const Prepared& prepared = small_plan();
  const std::vector<double>& seconds = prepared.capture_by_lights;
  ASSERT_EQ(seconds.size(), 3U);
  for (std::size_t i = 1; i < seconds.size(); ++i) EXPECT_GT(seconds[i], seconds[i - 1] + 5);
  EXPECT_DOUBLE_EQ(seconds.back(), prepared.plan.predicted_capture_time);
  // The first light alone, and the one held out: home, the two, and the darks.
  const Scratch scratch;
  const Rig rig = small_rig(scratch.path());
  Plan two;
  two.shots = {prepared.plan.shots[0], prepared.plan.shots[3]};
  double least = 1e9;
  for (const std::vector<int>& order : {std::vector<int>{0, 1}, std::vector<int>{1, 0}}) {
    two.visit_order = order;
    least = std::min(least, capture_time(rig, spec_of(rig), two, &prepared.object.mesh).total());
  }
  EXPECT_DOUBLE_EQ(seconds[0], least);
}

// Four exposures: 4 dark frames; 4 lights of an ambient frame and 4 exposures. 48 × 36 sites of two
// bytes, and of twelve for the radiance of each light.
TEST(LargestSession, CountsOneDarkFrameForEveryExposureAndTheRadiance) {
  const Scratch scratch;
  const Rig rig = small_rig(scratch.path());
  const SessionSize size = largest_session(rig, spec_of(rig), small_plan().plan);
  EXPECT_EQ(size.frames, 4 + 4 * 5);
  EXPECT_EQ(size.bytes, 48 * 36 * (2 * 24 + 12 * 4));
}

TEST(Prepare, LeavesOutLightsThatNoWayLeadsTo) {
  const Scratch scratch;
  Rig rig = small_rig(scratch.path());
  // A wall at azimuth 0 from the pole to the floor: from home, at −10°, nothing beyond is reached.
  rig.gantry.model.axes[0].home = -10 * degree;
  rig.keep_out.push_back(KeepOutBox{"wall", {-2, -0.02, -2}, {2, 0.02, 2}});
  const auto prepared = prepare(rig, spec_of(rig));
  ASSERT_TRUE(prepared) << prepared.error().message;
  for (const Shot& shot : prepared->plan.shots) EXPECT_LT(shot.gantry.axes[0], 0);
  EXPECT_THAT(prepared->remarks, testing::Contains(HasSubstr("no way leads to them")));
}

TEST(Prepare, SaysThatNothingTestsAPlanWithoutAHeldOutLight) {
  const Scratch scratch;
  const auto remarks = [&](const Rig& rig, const Plan* plan) {
    const auto prepared =
        plan == nullptr ? prepare(rig, spec_of(rig)) : prepare_with_plan(rig, spec_of(rig), *plan);
    return prepared ? prepared->remarks : std::vector<std::string>{prepared.error().message};
  };
  const auto said = testing::Contains(HasSubstr("will not know its error"));
  Plan plan = small_plan().plan;
  EXPECT_THAT(remarks(small_rig(scratch.path()), &plan), testing::Not(said));
  EXPECT_THAT(
      remarks(small_rig(scratch.path(), {{"held_out_lights = 1", "held_out_lights = 0"}}), nullptr),
      said);
  std::erase_if(plan.shots, &Shot::held_out);
  EXPECT_THAT(remarks(small_rig(scratch.path()), &plan), said)
      << "a session reduced from its folder";
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
  const auto prepared = prepare(rig, spec_of(rig), false, {stop.get_token()});
  ASSERT_FALSE(prepared);
  EXPECT_EQ(prepared.error().code, ErrorCode::stopped);
}

TEST(Prepare, BruteForceAsksForTheShadowOfEveryLitPoint) {
  const Scratch scratch;
  const Rig rig = small_rig(scratch.path());
  SessionSpec spec = spec_of(rig);
  spec.object.shape = "torus";
  spec.object.world_from_object.rotate(Eigen::AngleAxisd(60 * degree, Eigen::Vector3d::UnitX()));
  const auto fast = prepare(rig, spec), plain = prepare(rig, spec, true);
  ASSERT_TRUE(fast && plain);
  EXPECT_EQ(fast->bins.offset, plain->bins.offset);
  EXPECT_EQ(fast->bins.cell, plain->bins.cell);
  const BinningStatistics& little = fast->plan.left_out.binning;
  const BinningStatistics& all = plain->plan.left_out.binning;
  EXPECT_GT(little.rays_left_out, 0);
  EXPECT_EQ(all.rays_left_out, 0);
  EXPECT_EQ(all.rays_cast, all.points_tested);
  spec.plan.shadows = ShadowRays::none;
  const auto unshaded = prepare(rig, spec, true), quick = prepare(rig, spec);
  ASSERT_TRUE(unshaded && quick);
  const BinningStatistics& none = unshaded->plan.left_out.binning;
  EXPECT_EQ(none.rays_cast, 0);
  EXPECT_EQ(none.rays_left_out, none.points_tested) << "every point was looked at by itself";
  EXPECT_EQ(none.passed_over, 0);
  EXPECT_EQ(unshaded->bins.cell, quick->bins.cell);
  EXPECT_NE(unshaded->bins.cell, plain->bins.cell);
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
