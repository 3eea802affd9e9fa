#include "cli/plan_svg.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "core/shapes.h"

namespace lightrig::cli {
namespace {

using testing::HasSubstr, testing::Not;

// A ball ten metres from the world's origin, and lamps in these directions from it.
Prepared prepared_with(const std::vector<Eigen::Vector3d>& directions) {
  Prepared prepared;
  prepared.object.mesh = make_sphere(0.05, 1);
  prepared.object.mesh.vertices.colwise() += Eigen::Vector3d(10, 0, 0.5);
  prepared.bins.offset = {0};
  prepared.bins.grid = BivariateGrid{90, 90};
  for (const Eigen::Vector3d& direction : directions) {
    Candidate candidate;
    candidate.light = {false, Eigen::Vector3d(10, 0, 0.5) + direction.normalized()};
    Shot shot;
    shot.candidate = static_cast<int>(prepared.candidates.size());
    shot.light = candidate.light;
    prepared.plan.visit_order.push_back(shot.candidate);
    prepared.plan.shots.push_back(shot);
    prepared.candidates.push_back(candidate);
    prepared.bins.cell.push_back(7 + shot.candidate);
    prepared.bins.offset.push_back(static_cast<std::int64_t>(prepared.bins.cell.size()));
  }
  return prepared;
}

/// A camera as far from the ball as the lamps, towards −y at 45° above the horizon.
Rig rig_with_camera() {
  Rig rig;
  const Eigen::Vector3d eye = Eigen::Vector3d(10, -1, 1.5), ahead = Eigen::Vector3d(0, 1, -1);
  rig.camera.model.camera_from_world.linear() =
      Eigen::Quaterniond::FromTwoVectors(ahead, Eigen::Vector3d::UnitZ()).matrix();
  rig.camera.model.camera_from_world.translation() =
      -(rig.camera.model.camera_from_world.linear() * eye);
  return rig;
}

// A lamp straight above: the middle of the picture is what lies straight above the object.
TEST(PlanSvg, ShowsLampsAsTheObjectSeesThem) {
  EXPECT_THAT(plan_svg(rig_with_camera(), prepared_with({{0, 0, 1}})),
              HasSubstr("<circle cx='210.0' cy='210.0' r='8' class='light'/>"));
}

TEST(PlanSvg, SaysWhichWayIsWhichAndWhereTheCameraStands) {
  const std::string svg = plan_svg(rig_with_camera(), prepared_with({{0, 0, 1}}));
  for (const char* words : {"0° +x", "90° +y", "180°", "270°", ">1 cell<"})
    EXPECT_THAT(svg, HasSubstr(words));
  // Below the middle by a quarter of the radius: 45° from the zenith, towards −y.
  EXPECT_THAT(svg, HasSubstr("<path d='M210.0 253.8m"));
  EXPECT_THAT(svg, Not(HasSubstr("as the object sees it")));
  Rig table = rig_with_camera();
  table.gantry.model.kinematics = TurntableKinematics{};
  EXPECT_THAT(plan_svg(table, prepared_with({{0, 0, 1}})), HasSubstr("as the object sees it"));
}

TEST(PlanSvg, CoversNoLightByAnother) {
  Prepared prepared = prepared_with({{0, 0, 1}, {0.001, 0, 1}, {0, 0, 1}, {1, 0, 0}, {0, 1, 0}});
  prepared.plan.shots[3].held_out = prepared.plan.shots[4].held_out = true;
  const std::string svg = plan_svg(rig_with_camera(), prepared);
  for (const char* name : {">1</text>", ">3</text>", ">H1</text>", ">H2</text>"})
    EXPECT_THAT(svg, HasSubstr(name));
  std::vector<Eigen::Vector2d> discs;
  for (auto at = svg.find("r='8'"); at != std::string::npos; at = svg.find("r='8'", at + 1)) {
    const auto from = svg.rfind('<', at);
    const auto x = svg.find("cx='", from);
    if (x > at) continue;  // the legend's
    discs.emplace_back(std::stod(svg.substr(x + 4)),
                       std::stod(svg.substr(svg.find("cy='", x) + 4)));
  }
  ASSERT_EQ(discs.size(), 5U);
  for (std::size_t i = 0; i < discs.size(); ++i)
    for (std::size_t j = 0; j < i; ++j) EXPECT_GT((discs[i] - discs[j]).norm(), 16) << i << j;
  EXPECT_THAT(svg, HasSubstr("class='lead'"));
}

}  // namespace
}  // namespace lightrig::cli
