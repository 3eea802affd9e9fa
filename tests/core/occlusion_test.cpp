#include "core/occlusion.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <random>

#include "core/shapes.h"
#include "core/surface_points.h"
#include "planner_scene.h"

namespace lightrig {
namespace {

/// A unit square in z = 0 with a smaller one above its middle at z = 0.5, both facing up.
Mesh table_over_floor(double size) {
  Mesh mesh;
  mesh.vertices.resize(3, 8);
  mesh.vertices << -1, 1, 1, -1, -0.2, 0.2, 0.2, -0.2,  //
      -1, -1, 1, 1, -0.2, -0.2, 0.2, 0.2,               //
      0, 0, 0, 0, 0.5, 0.5, 0.5, 0.5;
  mesh.vertices *= size;
  mesh.normals = Eigen::Vector3d::UnitZ().replicate(1, 8);
  mesh.triangles.resize(3, 4);
  mesh.triangles << 0, 0, 4, 4, 1, 2, 5, 6, 2, 3, 6, 7;
  return mesh;
}

TEST(Occluder, AnswersByHandForATableOverAFloorOfAnySize) {
  for (const double size : {1e-4, 1.0, 1e3}) {
    const Occluder occluder(table_over_floor(size));
    const Eigen::Vector3d up = Eigen::Vector3d::UnitZ();
    const LightPosition above{true, up};
    EXPECT_TRUE(occluder.blocked(Eigen::Vector3d(0, 0, 0), up, above)) << size;
    EXPECT_FALSE(occluder.blocked(Eigen::Vector3d(0.3, 0, 0) * size, up, above)) << size;
    // The table top does not shade itself.
    EXPECT_FALSE(occluder.blocked(Eigen::Vector3d(0, 0, 0.5) * size, up, above)) << size;
    // A lamp between floor and table is not blocked by the table behind it.
    EXPECT_FALSE(
        occluder.blocked(Eigen::Vector3d(0, 0, 0), up, {false, Eigen::Vector3d(0, 0, 0.4) * size}))
        << size;
    EXPECT_TRUE(
        occluder.blocked(Eigen::Vector3d(0, 0, 0), up, {false, Eigen::Vector3d(0, 0, 0.6) * size}))
        << size;
    const auto hit = occluder.first_hit({Eigen::Vector3d(0.1, 0.05, 5000) * size, -up});
    ASSERT_TRUE(hit.has_value()) << size;
    EXPECT_NEAR(hit->distance, 4999.5 * size, 1e-9 * size);
    EXPECT_GE(hit->triangle, 2);
    EXPECT_FALSE(occluder.first_hit({Eigen::Vector3d(3, 0, 5) * size, -up}).has_value());
    EXPECT_FALSE(occluder.convex());
  }
}

TEST(Occluder, ManyPointsAtOnceAnswerAsEachAlone) {
  const Occluder occluder(table_over_floor(1));
  std::mt19937_64 random(5);
  std::uniform_real_distribution<double> side(-1, 1);
  std::vector<Eigen::Vector3d> points, normals;
  for (int i = 0; i < 1003; ++i) {
    points.emplace_back(side(random), side(random), 0.0);
    normals.push_back(Eigen::Vector3d::UnitZ());
  }
  const LightPosition light{false, Eigen::Vector3d(0.3, 0.2, 2)};
  std::vector<std::uint8_t> out(points.size());
  occluder.blocked(points, normals, light, out);
  int blocked = 0;
  for (std::size_t i = 0; i < points.size(); ++i) {
    ASSERT_EQ(out[i] != 0, occluder.blocked(points[i], normals[i], light));
    blocked += out[i];
  }
  EXPECT_GT(blocked, 20);
}

TEST(Occluder, FindsASphereConvexAndOneWithADentNot) {
  Mesh sphere = test::sphere_mesh(4);
  EXPECT_TRUE(Occluder(sphere).convex());
  Mesh dented = sphere;
  dented.vertices.col(0) *= 0.5;
  EXPECT_FALSE(Occluder(dented).convex());
  Mesh open = sphere;
  open.triangles.conservativeResize(3, open.triangles.cols() - 1);
  EXPECT_FALSE(Occluder(open).convex());
  Mesh inside_out = sphere;
  inside_out.triangles.row(1).swap(inside_out.triangles.row(2));
  EXPECT_FALSE(Occluder(inside_out).convex());
  Mesh two = sphere;
  two.vertices.conservativeResize(3, 2 * sphere.vertices.cols());
  two.vertices.rightCols(sphere.vertices.cols()) =
      sphere.vertices.colwise() + Eigen::Vector3d(5, 0, 0);
  two.normals = sphere.normals.replicate(1, 2);
  two.triangles.conservativeResize(3, 2 * sphere.triangles.cols());
  two.triangles.rightCols(sphere.triangles.cols()) =
      sphere.triangles.array() + static_cast<int>(sphere.vertices.cols());
  EXPECT_FALSE(Occluder(two).convex());
}

TEST(Occluder, NothingFacingTheLampIsBlockedOnAConvexBody) {
  // Rays from the faces themselves, with the faces' own normals, through the same tree.
  const Mesh sphere = test::sphere_mesh(3);
  const Occluder occluder(sphere);
  for (const LightPosition& light : test::spread_lights(50, true, 0)) {
    for (Eigen::Index t = 0; t < sphere.triangles.cols(); ++t) {
      const Eigen::Vector3d a = sphere.vertices.col(sphere.triangles(0, t));
      const Eigen::Vector3d b = sphere.vertices.col(sphere.triangles(1, t));
      const Eigen::Vector3d c = sphere.vertices.col(sphere.triangles(2, t));
      const Eigen::Vector3d n = (b - a).cross(c - a).normalized();
      if (n.dot(light.p) <= 1e-3) continue;
      ASSERT_FALSE(occluder.blocked((a + b + c) / 3, n, light));
    }
  }
}

TEST(Occluder, KnowsTheHorizonOfATableByHand) {
  const Occluder occluder(table_over_floor(1));
  const Eigen::Vector3d up = Eigen::Vector3d::UnitZ();
  // Straight under the table top the sky is nowhere sure; on top of it, everywhere.
  EXPECT_GE(occluder.horizon(Eigen::Vector3d(0.05, 0.05, 0), up), 1);
  EXPECT_LT(occluder.horizon(Eigen::Vector3d(0, 0, 0.5), up), 0.1);
  // Beside it: the top's nearest edge is 0.6 away and 0.5 high. No lower; higher by what stands for
  // the triangle at a corner, 0.25 / (0.65 - 0.16) for a sine of 0.25 / 0.65, and by the room left.
  const double sine = 0.5 / std::hypot(0.6, 0.5);
  const double found = occluder.horizon(Eigen::Vector3d(0.8, 0, 0), up);
  EXPECT_GT(found, sine);
  EXPECT_LT(found, 1.26 * sine);
}

TEST(Occluder, BlocksNothingAboveAHorizon) {
  const Mesh torus = make_torus(0.7, 0.3, 2), teapot = make_teapot(1, 1);
  for (const Mesh& mesh : {torus, teapot}) {
    const Occluder occluder(mesh);
    std::mt19937_64 random(11);
    std::normal_distribution<double> normal;
    int sure = 0, blocked = 0;
    for (Eigen::Index i = 0; i < mesh.vertices.cols(); i += 3) {
      const Eigen::Vector3d p = mesh.vertices.col(i), n = mesh.normals.col(i);
      const double horizon = occluder.horizon(p, n);
      for (int k = 0; k < 40; ++k) {
        Eigen::Vector3d l(normal(random), normal(random), normal(random));
        l.normalize();
        if (n.dot(l) < 0) l = -l;
        const bool shaded = occluder.blocked(p, n, {true, l});
        if (n.dot(l) > horizon) {
          ++sure;
          ASSERT_FALSE(shaded) << "vertex " << i << ", n·l " << n.dot(l) << " above " << horizon;
        } else {
          blocked += shaded ? 1 : 0;
        }
      }
    }
    EXPECT_GT(sure, 1000);
    EXPECT_GT(blocked, 1000);
  }
}

TEST(SurfacePoints, PixelsOfASphereLieOnItWithItsNormals) {
  const Mesh sphere = test::sphere_mesh(5);
  const Occluder occluder(sphere);
  for (const bool is_distant : {true, false}) {
    const CameraModel camera = test::facing_camera(is_distant, 5, 64, 48);
    const SurfacePoints points = points_of_pixels(sphere, occluder, camera, 1);
    // The disc of radius 0.45 · 48 px.
    EXPECT_NEAR(static_cast<double>(points.size()), 3.14159 * 21.6 * 21.6, 60);
    for (Eigen::Index i = 0; i < points.size(); ++i) {
      const Eigen::Vector3d p = points.position.col(i);
      ASSERT_NEAR(p.norm(), 1, 2e-3);
      ASSERT_LT((points.normal.col(i) - p.normalized()).norm(), 3e-3);
      ASSERT_NEAR(points.view.col(i).dot(view_direction(camera, p)), 1, 1e-12);
      const Eigen::Vector2d pixel = project(camera, p);
      const int source = points.source[static_cast<std::size_t>(i)];
      ASSERT_NEAR(pixel.x(), source % 64, 1e-6);
      ASSERT_NEAR(pixel.y(), source / 64, 1e-6);
    }
  }
}

TEST(SurfacePoints, VerticesBehindTheTableAreHiddenFromAbove) {
  const Mesh mesh = table_over_floor(1);
  const Occluder occluder(mesh);
  CameraModel camera;
  camera.projection = CameraModel::Projection::orthographic;
  camera.width = camera.height = 100;
  camera.fx = camera.fy = 30;
  camera.cx = camera.cy = 49.5;
  camera.camera_from_world =
      look_at(Eigen::Vector3d(0, 0, 5), Eigen::Vector3d::Zero(), Eigen::Vector3d::UnitY());
  EXPECT_EQ(points_of_vertices(mesh, occluder, camera).size(), 8);
  // Seen from far below nothing faces the camera.
  camera.camera_from_world =
      look_at(Eigen::Vector3d(0, 0, -5), Eigen::Vector3d::Zero(), Eigen::Vector3d::UnitY());
  EXPECT_EQ(points_of_vertices(mesh, occluder, camera).size(), 0);
}

}  // namespace
}  // namespace lightrig
