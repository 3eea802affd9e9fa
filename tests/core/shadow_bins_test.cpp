// Bins with shadows against one ray for every lit point, on objects where shortcuts might go wrong,
// and what binning counts.

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <string>
#include <vector>

#include "bins_by_hand.h"
#include "core/candidate_bins.h"
#include "planner_scene.h"

namespace lightrig {
namespace {

Mesh with(const Mesh& a, const Mesh& b) {
  Mesh both;
  const Eigen::Index n = a.vertices.cols(), t = a.triangles.cols();
  both.vertices.resize(3, n + b.vertices.cols());
  both.normals.resize(3, n + b.vertices.cols());
  both.triangles.resize(3, t + b.triangles.cols());
  both.vertices << a.vertices, b.vertices;
  both.normals << a.normals, b.normals;
  both.triangles << a.triangles, b.triangles.array() + static_cast<int>(n);
  return both;
}

Mesh turned_inside_out(Mesh mesh) {
  mesh.normals = -mesh.normals;
  mesh.triangles.row(1).swap(mesh.triangles.row(2));
  return mesh;
}

/// A closed cylinder of few sides with round normals: its lids have corners of their own.
Mesh coarse_cylinder(int sides) {
  Mesh mesh;
  mesh.vertices.resize(3, 4 * sides);
  mesh.normals.resize(3, 4 * sides);
  mesh.triangles.resize(3, 2 * sides + 2 * (sides - 2));
  int t = 0;
  for (int i = 0; i < sides; ++i) {
    const double a = 2 * std::numbers::pi * i / sides;
    const Eigen::Vector3d round(std::cos(a), std::sin(a), 0);
    for (int k = 0; k < 4; ++k) {  // wall below and above, lid below and above
      const Eigen::Vector3d up(0, 0, k % 2 == 0 ? -1 : 1);
      mesh.vertices.col(4 * i + k) = 0.6 * round + 0.7 * up;
      mesh.normals.col(4 * i + k) = k < 2 ? round : up;
    }
    const int j = (i + 1) % sides;
    mesh.triangles.col(t++) = Eigen::Vector3i(4 * i, 4 * j, 4 * j + 1);
    mesh.triangles.col(t++) = Eigen::Vector3i(4 * i, 4 * j + 1, 4 * i + 1);
    if (i == 0 || j == 0) continue;
    mesh.triangles.col(t++) = Eigen::Vector3i(2, 4 * j + 2, 4 * i + 2);
    mesh.triangles.col(t++) = Eigen::Vector3i(3, 4 * i + 3, 4 * j + 3);
  }
  return mesh;
}

/// Every second vertex normal leans far over, more than any face beside it.
Mesh with_leaning_normals(Mesh mesh) {
  for (Eigen::Index i = 0; i < mesh.normals.cols(); i += 2) {
    mesh.normals.col(i) = (mesh.normals.col(i) + Eigen::Vector3d(0.6, 0.3, 0.4)).normalized();
  }
  return mesh;
}

struct Scene {
  Mesh mesh;
  Occluder occluder;
  SurfacePoints points;
  std::vector<LightPosition> lights;

  Scene(Mesh m, bool distant, bool pixels, int count)
      : mesh(std::move(m)), occluder(mesh), lights(test::spread_lights(count, distant, 3)) {
    const CameraModel camera = test::facing_camera(distant, 4, 64, 56);
    points = pixels ? points_of_pixels(mesh, occluder, camera, 1)
                    : points_of_vertices(mesh, occluder, camera);
  }
  BinningResult bins(const GrazingLimits& limits, ShadowRays rays) const {
    return bin_candidates(points, lights, {}, {}, limits, occluder, rays, 1);
  }
};

/// How many cells shadows take, where both ways agree with every ray cast by hand.
std::size_t cells_in_shadow(const Scene& scene, const GrazingLimits& limits) {
  const BinningResult needed = scene.bins(limits, ShadowRays::needed),
                      all = scene.bins(limits, ShadowRays::all);
  for (std::size_t i = 0; i < scene.lights.size(); ++i) {
    const auto expected =
        test::bins_by_hand(scene.points, scene.lights[i], {}, limits, scene.occluder);
    for (const BinningResult* result : {&needed, &all}) {
      const auto found = result->bins.of(static_cast<int>(i));
      EXPECT_EQ(std::vector<std::int32_t>(found.begin(), found.end()), expected)
          << "light " << i << (result == &all ? " all" : " needed");
    }
  }
  EXPECT_LT(needed.statistics.rays_cast, all.statistics.rays_cast);
  return scene.bins(limits, ShadowRays::none).bins.cell.size() - all.bins.cell.size();
}

TEST(ShadowBins, OfACoarseConvexObjectWithRoundNormalsAreThoseOfEveryRay) {
  // Where a round normal faces the lamp and its flat face does not, the point is in the shadow of
  // its own face.
  for (const bool distant : {true, false}) {
    std::size_t dark = 0;
    for (const Mesh& mesh : {test::sphere_mesh(1), test::sphere_mesh(2), coarse_cylinder(9)}) {
      ASSERT_TRUE(Occluder(mesh).convex());
      const Scene pixels(mesh, distant, true, 60);
      dark += cells_in_shadow(pixels, no_grazing_limits);
      cells_in_shadow(pixels, {});
      const Scene vertices(mesh, distant, false, 60);
      EXPECT_EQ(cells_in_shadow(vertices, no_grazing_limits), 0U);
      EXPECT_EQ(vertices.bins(no_grazing_limits, ShadowRays::needed).statistics.rays_cast, 0);
    }
    EXPECT_GT(dark, 0U) << distant;
    const Scene leaning(with_leaning_normals(test::sphere_mesh(3)), distant, false, 60);
    ASSERT_TRUE(leaning.occluder.convex());
    EXPECT_GT(cells_in_shadow(leaning, no_grazing_limits), 0U);
  }
}

/// The half of a ball that is above the horizontal, or, turned, the one behind, open to the camera.
Mesh half_ball(const Mesh& ball, bool turned) {
  Mesh half = ball;
  half.triangles.conservativeResize(3, half.triangles.cols() / 2);
  if (!turned) return half;
  for (Eigen::Matrix3Xd* of : {&half.vertices, &half.normals}) {
    of->row(1).swap(of->row(2));
    of->row(2) *= -1;
  }
  return half;
}

TEST(ShadowBins, OfThinAndOpenAndDoubledSheetsAreThoseOfEveryRay) {
  const Mesh ball = test::sphere_mesh(3);
  for (const bool turned : {false, true}) {
    const Mesh outer = half_ball(ball, turned);
    for (const double thickness : {1e-5, 1e-4, 1e-3, 1e-2}) {
      Mesh inner = turned_inside_out(outer);
      inner.vertices *= 1 - thickness;
      const Mesh shell = with(outer, inner);
      for (const bool pixels : {true, false}) {
        cells_in_shadow(Scene(shell, true, pixels, 30), no_grazing_limits);
      }
      cells_in_shadow(Scene(shell, false, true, 30), no_grazing_limits);
    }
  }
  const Mesh inside = turned_inside_out(half_ball(ball, true));
  for (const bool distant : {true, false}) {
    cells_in_shadow(Scene(with(ball, ball), distant, true, 30), no_grazing_limits);
    cells_in_shadow(Scene(with(turned_inside_out(inside), inside), distant, true, 30), {});
    EXPECT_GT(cells_in_shadow(Scene(inside, distant, true, 60), {}), 0U);
  }
}

TEST(ShadowBins, CountEveryPairOnceAndWhatWasLeftOutAddsUp) {
  Mesh pair = test::sphere_mesh(4);
  pair.vertices = (0.5 * pair.vertices).colwise() - Eigen::Vector3d(0.4, 0, 0);
  Mesh other = pair;
  other.vertices.colwise() += Eigen::Vector3d(0.8, 0.1, 0.2);
  std::vector<std::uint8_t> valid(static_cast<std::size_t>(BivariateGrid{}.cells()), 1);
  for (std::size_t c = 0; c < valid.size(); c += 3) valid[c] = 0;
  for (const Mesh& mesh : {with(pair, other), test::sphere_mesh(2), test::sphere_mesh(5)}) {
    for (const bool distant : {true, false}) {
      for (const bool pixels : {true, false}) {
        const Scene scene(mesh, distant, pixels, 60);
        for (const ShadowRays rays : {ShadowRays::none, ShadowRays::needed, ShadowRays::all}) {
          for (const bool masked : {false, true}) {
            for (const GrazingLimits& limits : {GrazingLimits{}, no_grazing_limits}) {
              const BinningResult result = bin_candidates(
                  scene.points, scene.lights, {},
                  masked ? std::span<const std::uint8_t>(valid) : std::span<const std::uint8_t>{},
                  limits, scene.occluder, rays, 1);
              const BinningStatistics& s = result.statistics;
              const auto pairs = static_cast<std::int64_t>(scene.lights.size()) *
                                 static_cast<std::int64_t>(scene.points.size());
              const auto filled = static_cast<std::int64_t>(result.bins.cell.size());
              EXPECT_EQ(s.points_tested + s.back_facing + s.no_half_vector + s.passed_over, pairs);
              EXPECT_EQ(s.rays_cast + s.rays_left_out, s.points_tested);
              EXPECT_EQ(filled + s.repeated + s.in_shadow, s.points_tested);
              for (const std::int64_t count :
                   {s.points_tested, s.back_facing, s.no_half_vector, s.passed_over, s.rays_cast,
                    s.rays_left_out, s.repeated, s.in_shadow}) {
                EXPECT_GE(count, 0);
              }
              if (rays == ShadowRays::all && !masked) {
                EXPECT_EQ(s.rays_cast, s.points_tested);
              }
              if (rays == ShadowRays::all) {
                EXPECT_EQ(s.passed_over, 0);
              }
            }
          }
        }
      }
    }
  }
}

}  // namespace
}  // namespace lightrig
