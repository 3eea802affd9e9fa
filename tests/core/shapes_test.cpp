#include "core/shapes.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <numbers>

#include "core/mesh_repair.h"
#include "core/teapot_patches.h"

namespace lightrig {
namespace {

constexpr double pi = std::numbers::pi;

int euler_characteristic(const Mesh& mesh, int boundary_edges) {
  // Every inner edge belongs to two triangles, every boundary edge to one.
  const auto t = static_cast<int>(mesh.triangles.cols());
  const int edges = (3 * t + boundary_edges) / 2;
  return static_cast<int>(mesh.vertices.cols()) - edges + t;
}

double least_agreement(const Mesh& mesh) {
  double least = 1;
  for (Eigen::Index i = 0; i < mesh.triangles.cols(); ++i) {
    const Eigen::Vector3i t = mesh.triangles.col(i);
    const Eigen::Vector3d a = mesh.vertices.col(t[0]);
    const Eigen::Vector3d ab = mesh.vertices.col(t[1]) - a, ac = mesh.vertices.col(t[2]) - a;
    const Eigen::Vector3d n = ab.cross(ac).normalized();
    for (Eigen::Index k = 0; k < 3; ++k) least = std::min(least, n.dot(mesh.normals.col(t[k])));
  }
  return least;
}

TEST(Sphere, HasTheCountsOfAGeodesicOfFrequencySixteen) {
  const Mesh mesh = make_sphere(0.05, 1);
  EXPECT_EQ(mesh.triangles.cols(), 20 * 16 * 16);
  EXPECT_EQ(mesh.vertices.cols(), 10 * 16 * 16 + 2);
  EXPECT_EQ(euler_characteristic(mesh, 0), 2);
}

TEST(Sphere, AreaAndVolumeTendToTheClosedFormsQuadratically) {
  const double r = 0.05, area = 4 * pi * r * r, volume = 4.0 / 3.0 * pi * r * r * r;
  const double area_1 = area - surface_area(make_sphere(r, 1));
  const double area_2 = area - surface_area(make_sphere(r, 2));
  const double volume_1 = volume - signed_volume(make_sphere(r, 1));
  const double volume_2 = volume - signed_volume(make_sphere(r, 2));
  EXPECT_GT(area_2, 0);
  EXPECT_LT(area_1 / area, 2e-3);
  EXPECT_NEAR(area_1 / area_2, 4, 0.05);
  EXPECT_GT(volume_2, 0);
  EXPECT_NEAR(volume_1 / volume_2, 4, 0.05);
}

TEST(Sphere, NormalsAreThePositions) {
  const Mesh mesh = make_sphere(2, 1);
  EXPECT_LT((mesh.vertices - 2 * mesh.normals).cwiseAbs().maxCoeff(), 1e-15);
  EXPECT_LT((mesh.normals.colwise().norm().array() - 1).abs().maxCoeff(), 1e-15);
}

TEST(Torus, AreaAndVolumeTendToPappus) {
  const double R = 0.04, r = 0.015;
  const double area = 4 * pi * pi * R * r, volume = 2 * pi * pi * R * r * r;
  const Mesh mesh = make_torus(R, r, 2), coarse = make_torus(R, r, 1);
  EXPECT_NEAR(surface_area(mesh) / area, 1, 1e-3);
  EXPECT_NEAR((volume - signed_volume(coarse)) / (volume - signed_volume(mesh)), 4, 0.05);
  EXPECT_EQ(euler_characteristic(mesh, 0), 0);
}

TEST(Cylinder, IsClosedWithASharpRim) {
  const double r = 0.03, h = 0.1;
  const Mesh mesh = make_cylinder(r, h, 2);
  EXPECT_NEAR(signed_volume(mesh) / (pi * r * r * h), 1, 2e-3);
  EXPECT_NEAR(surface_area(mesh) / (2 * pi * r * (h + r)), 1, 2e-3);
  const MeshRepairs repairs = repaired(mesh).repairs;
  EXPECT_EQ(repairs.boundary_edges, 0);
  EXPECT_EQ(repairs.duplicate_vertices, 0);
  EXPECT_EQ(repairs.components, 1);
  EXPECT_GT(least_agreement(mesh), 0.99);
}

TEST(Plane, FacesUpAndHasItsArea) {
  const Mesh mesh = make_plane(0.2, 0.1, 1);
  EXPECT_NEAR(surface_area(mesh), 0.02, 1e-15);
  EXPECT_DOUBLE_EQ(least_agreement(mesh), 1);
  EXPECT_TRUE(mesh.vertices.row(2).isZero());
}

TEST(EveryShape, NeedsNoRepairAndFacesOutwards) {
  for (const Mesh& mesh : {make_sphere(1, 1), make_torus(2, 1, 1), make_cylinder(1, 1, 1),
                           make_plane(1, 1, 1), make_teapot(1, 1)}) {
    const RepairedMesh again = repaired(mesh);
    EXPECT_TRUE(again.mesh.vertices == mesh.vertices);
    EXPECT_TRUE(again.mesh.triangles == mesh.triangles);
    EXPECT_LT((again.mesh.normals - mesh.normals).cwiseAbs().maxCoeff(), 1e-15);
    EXPECT_EQ(again.repairs.turned_normals, 0);
    EXPECT_FALSE(again.repairs.flipped_orientation || again.repairs.computed_normals);
  }
}

TEST(Teapot, HasThirtyTwoPatchesWhoseControlPointsReachThePublishedExtremes) {
  const auto patches = teapot_patches();
  ASSERT_EQ(patches.size(), 32U);
  Eigen::AlignedBox3d box;
  for (const BicubicPatch& patch : patches)
    for (const Eigen::Vector3d& p : patch) box.extend(p);
  EXPECT_TRUE(box.min().isApprox(Eigen::Vector3d(-3, -2, 0)));
  EXPECT_TRUE(box.max().isApprox(Eigen::Vector3d(3.525, 2, 3.15)));
}

TEST(Teapot, IsSymmetricAboutItsVerticalPlaneControlPointForControlPoint) {
  // A slip in one of the 306 published numbers would break the mirror image.
  std::vector<Eigen::Vector3d> points;
  for (const BicubicPatch& patch : teapot_patches())
    points.insert(points.end(), patch.begin(), patch.end());
  for (const Eigen::Vector3d& p : points) {
    const Eigen::Vector3d mirrored(p.x(), -p.y(), p.z());
    EXPECT_TRUE(std::any_of(points.begin(), points.end(), [&](const Eigen::Vector3d& q) {
      return (q - mirrored).isZero(0);
    })) << p.transpose();
  }
}

TEST(Teapot, HasTheBoundariesAndPartsOfThePublishedModel) {
  // Divided 6 × 6: open at rim, lid, both ends of handle and spout, each of 4 × 6 or 2 × 6 edges;
  // the handle's end touches the body in one vertex.
  const Mesh mesh = tessellate_teapot(6);
  const MeshRepairs repairs = repaired(mesh).repairs;
  EXPECT_EQ(mesh.triangles.cols(), 2256);
  EXPECT_EQ(mesh.vertices.cols(), 1178);
  EXPECT_EQ(repairs.boundary_edges, 96);
  EXPECT_EQ(repairs.non_manifold_edges, 0);
  EXPECT_EQ(repairs.components, 3);
}

TEST(Teapot, HasPolesWithVerticalNormals) {
  const auto patches = teapot_patches();
  const PatchPoint top = evaluate(patches[20], 0, 0.3), bottom = evaluate(patches[28], 0, 0.7);
  EXPECT_TRUE(top.position.isApprox(Eigen::Vector3d(0, 0, 3.15)));
  EXPECT_LT((top.normal - Eigen::Vector3d::UnitZ()).norm(), 1e-12);
  EXPECT_LT(bottom.position.norm(), 1e-12);
  EXPECT_LT((bottom.normal + Eigen::Vector3d::UnitZ()).norm(), 1e-12);
}

TEST(Teapot, HasAnalyticNormalsThatAgreeWithDifferencesOfPositions) {
  for (const BicubicPatch& patch : teapot_patches()) {
    for (const double u : {0.2, 0.55, 0.9}) {
      for (const double v : {0.1, 0.5, 0.8}) {
        const double h = 1e-6;
        const Eigen::Vector3d du =
            evaluate(patch, u + h, v).position - evaluate(patch, u - h, v).position;
        const Eigen::Vector3d dv =
            evaluate(patch, u, v + h).position - evaluate(patch, u, v - h).position;
        EXPECT_LT((dv.cross(du).normalized() - evaluate(patch, u, v).normal).norm(), 1e-6);
      }
    }
  }
}

TEST(Teapot, FillsItsHeightCentredOnTheOriginWithNormalsOutwards) {
  const Mesh mesh = make_teapot(0.1, 1);
  EXPECT_NEAR(mesh.vertices.row(2).maxCoeff(), 0.05, 1e-15);
  EXPECT_NEAR(mesh.vertices.row(2).minCoeff(), -0.05, 1e-15);
  EXPECT_NEAR(mesh.vertices.row(0).maxCoeff() + mesh.vertices.row(0).minCoeff(), 0, 1e-4);
  EXPECT_NEAR(mesh.vertices.row(1).maxCoeff() + mesh.vertices.row(1).minCoeff(), 0, 1e-15);
  EXPECT_GT(least_agreement(mesh), 0.3);  // 0.38 at the curled rim
  EXPECT_LT((mesh.normals.colwise().norm().array() - 1).abs().maxCoeff(), 1e-12);
}

}  // namespace
}  // namespace lightrig
