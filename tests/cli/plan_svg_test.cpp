#include "cli/plan_svg.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "core/shapes.h"

namespace lightrig::cli {
namespace {

// A ball ten metres from the world's origin, and a lamp straight above it: the middle of the
// picture is what lies straight above the object.
TEST(PlanSvg, ShowsLampsAsTheObjectSeesThem) {
  Prepared prepared;
  prepared.object.mesh = make_sphere(0.05, 1);
  prepared.object.mesh.vertices.colwise() += Eigen::Vector3d(10, 0, 0.5);
  Candidate above;
  above.light = {false, {10, 0, 1.5}};
  prepared.candidates = {above};
  prepared.bins.offset = {0, 1};
  prepared.bins.cell = {7};
  Shot shot;
  shot.candidate = 0;
  shot.light = above.light;
  prepared.plan.shots = {shot};
  prepared.plan.visit_order = {0};
  EXPECT_THAT(plan_svg(prepared),
              testing::HasSubstr("<circle cx='210.0' cy='210.0' r='9' class='light'/>"));
}

}  // namespace
}  // namespace lightrig::cli
