#include "core/candidate_bins.h"

#include <gtest/gtest.h>

#include "bins_by_hand.h"
#include "planner_scene.h"

namespace lightrig {
namespace {

struct View {
  Mesh mesh;
  Occluder occluder;
  SurfacePoints points;

  View(Mesh m, bool distant, bool pixels) : mesh(std::move(m)), occluder(mesh) {
    const CameraModel camera = test::facing_camera(distant, 4, 96, 80);
    points = pixels ? points_of_pixels(mesh, occluder, camera, 1)
                    : points_of_vertices(mesh, occluder, camera);
  }
};

/// Two spheres side by side: each shades the other.
Mesh two_spheres() {
  const Mesh one = test::sphere_mesh(4);
  const Eigen::Index n = one.vertices.cols(), t = one.triangles.cols();
  Mesh mesh;
  mesh.vertices.resize(3, 2 * n);
  mesh.vertices << (0.45 * one.vertices).colwise() - Eigen::Vector3d(0.45, 0, 0),
      (0.45 * one.vertices).colwise() + Eigen::Vector3d(0.45, 0.1, 0);
  mesh.normals = one.normals.replicate(1, 2);
  mesh.triangles.resize(3, 2 * t);
  mesh.triangles << one.triangles, one.triangles.array() + static_cast<int>(n);
  return mesh;
}

TEST(BinCandidates, EqualTheBinsOfTheAnglesThemselves) {
  const BivariateGrid grid;
  for (const bool distant : {true, false}) {
    const View view(two_spheres(), distant, true);
    const auto lights = test::spread_lights(60, distant, 3);
    for (const GrazingLimits& limits : {GrazingLimits{}, no_grazing_limits}) {
      for (const bool shadows : {false, true}) {
        const BinningResult result =
            bin_candidates(view.points, lights, grid, {}, limits, view.occluder,
                           shadows ? ShadowRays::needed : ShadowRays::none, 1);
        for (std::size_t i = 0; i < lights.size(); ++i) {
          const auto expected =
              test::bins_by_hand(view.points, lights[i], grid, limits, view.occluder, shadows);
          const auto found = result.bins.of(static_cast<int>(i));
          ASSERT_EQ(std::vector<std::int32_t>(found.begin(), found.end()), expected) << i;
        }
      }
    }
  }
}

TEST(BinCandidates, TheRaysNeededGiveTheSameBinsAsAllRays) {
  const View view(two_spheres(), true, true);
  const auto lights = test::spread_lights(100, true, 0);
  const auto bins = [&](ShadowRays rays, int threads) {
    return bin_candidates(view.points, lights, {}, {}, no_grazing_limits, view.occluder, rays,
                          threads);
  };
  const BinningResult all = bins(ShadowRays::all, 1), needed = bins(ShadowRays::needed, 1);
  EXPECT_EQ(all.bins.cell, needed.bins.cell);
  EXPECT_EQ(all.bins.offset, needed.bins.offset);
  EXPECT_NE(all.bins.cell, bins(ShadowRays::none, 1).bins.cell);
  EXPECT_LT(needed.statistics.rays_cast, all.statistics.rays_cast / 5);
  EXPECT_LE(needed.statistics.rays_cast, 2 * static_cast<std::int64_t>(needed.bins.cell.size()));
}

class BinsOfScans : public ::testing::TestWithParam<const char*> {};

TEST_P(BinsOfScans, AreTheSameFromTheRaysNeededAsFromOneRayForEveryLitPoint) {
  const auto folder = test::data_folder();
  if (!folder) GTEST_SKIP() << "no data folder (LIGHTRIG_DATA, ../shared/data)";
  const Mesh mesh = test::data_mesh(*folder, GetParam());
  const Occluder occluder(mesh);
  const CameraModel afar = test::facing_camera(true, 4, 200, 200);
  const CameraModel close = test::facing_camera(false, 4, 200, 200);
  const auto both = [&](const SurfacePoints& points, bool distant, const char* what) {
    const auto lights = test::spread_lights(16, distant, 3);
    const auto bins = [&](ShadowRays rays) {
      return bin_candidates(points, lights, {}, {}, {}, occluder, rays, 1);
    };
    const BinningResult all = bins(ShadowRays::all), needed = bins(ShadowRays::needed);
    EXPECT_EQ(all.bins.offset, needed.bins.offset) << what;
    EXPECT_EQ(all.bins.cell, needed.bins.cell) << what;
    EXPECT_LT(needed.statistics.rays_cast, all.statistics.rays_cast) << what;
  };
  both(points_of_vertices(mesh, occluder, afar), true, "vertices from afar, distant light");
  both(points_of_pixels(mesh, occluder, afar, 1), true, "pixels from afar, distant light");
  both(points_of_vertices(mesh, occluder, close), false, "vertices in perspective, near lamp");
}

INSTANTIATE_TEST_SUITE_P(BinCandidates, BinsOfScans,
                         ::testing::Values("bunny", "happy_buddha", "dragon", "teapot",
                                           "head_igea"),
                         [](const auto& mesh) { return std::string(mesh.param); });

TEST(BinCandidates, OfANearLampTheRaysNeededAreThoseCastAndThoseLeftOut) {
  const View view(two_spheres(), false, true);
  const auto lights = test::spread_lights(60, false, 3);
  const auto bins = [&](ShadowRays rays) {
    return bin_candidates(view.points, lights, {}, {}, {}, view.occluder, rays, 1);
  };
  const BinningResult all = bins(ShadowRays::all), needed = bins(ShadowRays::needed);
  EXPECT_EQ(all.bins.cell, needed.bins.cell);
  EXPECT_EQ(needed.statistics.rays_cast + needed.statistics.rays_left_out,
            all.statistics.rays_cast);
}

TEST(BinCandidates, DoNotDependOnTheNumberOfThreads) {
  const View view(two_spheres(), false, true);
  const auto lights = test::spread_lights(100, false, 3);
  const auto bins = [&](int threads) {
    return bin_candidates(view.points, lights, {}, {}, {}, view.occluder, ShadowRays::needed,
                          threads);
  };
  const BinningResult one = bins(1), four = bins(4);
  EXPECT_EQ(one.bins.cell, four.bins.cell);
  EXPECT_EQ(one.bins.offset, four.bins.offset);
  EXPECT_EQ(one.statistics.rays_cast, four.statistics.rays_cast);
  EXPECT_EQ(one.statistics.repeated, four.statistics.repeated);
  EXPECT_EQ(one.statistics.back_facing, four.statistics.back_facing);
}

TEST(BinCandidates, AConvexObjectNeedsNoRay) {
  const View view(test::sphere_mesh(5), true, true);
  const auto lights = test::spread_lights(50, true, 0);
  const BinningResult result =
      bin_candidates(view.points, lights, {}, {}, {}, view.occluder, ShadowRays::needed, 1);
  EXPECT_TRUE(result.statistics.convex);
  EXPECT_EQ(result.statistics.rays_cast, 0);
  EXPECT_GT(result.bins.cell.size(), 0U);
}

TEST(BinCandidates, ADistantLightSeenFromAfarIsOneColumn) {
  const View view(test::sphere_mesh(4), true, true);
  const auto lights = test::spread_lights(50, true, 0);
  const BinningResult result = bin_candidates(view.points, lights, {}, {}, no_grazing_limits,
                                              view.occluder, ShadowRays::none, 1);
  for (int i = 0; i < result.bins.candidates(); ++i) {
    for (const std::int32_t cell : result.bins.of(i)) {
      ASSERT_EQ(cell % 90, result.bins.of(i).front() % 90);
    }
  }
}

TEST(BinCandidates, LampsThatLightNothingHaveNoBins) {
  const View view(test::sphere_mesh(4), true, true);
  const Eigen::Vector3d v = view.points.view.col(0);
  // Straight behind the object, and a lamp at the centre of a solid sphere.
  const std::vector<LightPosition> lights = {{true, -v}, {false, Eigen::Vector3d::Zero()}};
  const BinningResult result = bin_candidates(view.points, lights, {}, {}, no_grazing_limits,
                                              view.occluder, ShadowRays::needed, 1);
  EXPECT_TRUE(result.bins.of(0).empty());
  EXPECT_TRUE(result.bins.of(1).empty());
}

TEST(BinCandidates, CellsWithoutStatisticsAreLeftOut) {
  const View view(test::sphere_mesh(4), true, true);
  const auto lights = test::spread_lights(20, true, 0);
  const BivariateGrid grid;
  std::vector<std::uint8_t> valid(static_cast<std::size_t>(grid.cells()), 0);
  for (std::size_t c = 0; c < valid.size(); c += 2) valid[c] = 1;
  const BinningResult result = bin_candidates(view.points, lights, grid, valid, no_grazing_limits,
                                              view.occluder, ShadowRays::none, 1);
  EXPECT_GT(result.bins.cell.size(), 0U);
  for (const std::int32_t cell : result.bins.cell) ASSERT_EQ(cell % 2, 0);
}

}  // namespace
}  // namespace lightrig
