#include "core/mesh_repair.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <limits>

#include "core/shapes.h"
#include "planner_scene.h"

namespace lightrig {
namespace {

Mesh without_normals(Mesh mesh) {
  mesh.normals.resize(3, 0);
  return mesh;
}

// The same surface as an STL file holds it: three vertices of its own for every triangle.
Mesh soup(const Mesh& mesh) {
  Mesh result;
  result.vertices.resize(3, 3 * mesh.triangles.cols());
  result.triangles.resize(3, mesh.triangles.cols());
  for (Eigen::Index i = 0; i < mesh.triangles.cols(); ++i) {
    for (Eigen::Index k = 0; k < 3; ++k) {
      result.vertices.col(3 * i + k) = mesh.vertices.col(mesh.triangles(k, i));
      result.triangles(k, i) = static_cast<int>(3 * i + k);
    }
  }
  return result;
}

Mesh inside_out(Mesh mesh) {
  mesh.triangles.row(1).swap(mesh.triangles.row(2));
  return mesh;
}

Mesh joined(const Mesh& a, const Mesh& b, const Eigen::Vector3d& offset_b) {
  Mesh result;
  result.vertices.resize(3, a.vertices.cols() + b.vertices.cols());
  result.vertices << a.vertices, b.vertices.colwise() + offset_b;
  result.triangles.resize(3, a.triangles.cols() + b.triangles.cols());
  result.triangles << a.triangles, b.triangles.array() + static_cast<int>(a.vertices.cols());
  return result;
}

TEST(RepairedMesh, WeldsATriangleSoupBackTogether) {
  const Mesh sphere = make_sphere(1, 1);
  const RepairedMesh result = repaired(soup(sphere));
  EXPECT_EQ(result.mesh.vertices.cols(), sphere.vertices.cols());
  EXPECT_EQ(result.repairs.duplicate_vertices,
            3 * sphere.triangles.cols() - sphere.vertices.cols());
  EXPECT_EQ(result.repairs.boundary_edges, 0);
  EXPECT_EQ(result.repairs.components, 1);
  EXPECT_TRUE(result.repairs.computed_normals);
}

TEST(RepairedMesh, ComputesNormalsOfASphereToHalfADegree) {
  const Mesh sphere = make_sphere(1, 1);
  const Mesh result = repaired(without_normals(sphere)).mesh;
  const double least = (result.normals.array() * sphere.normals.array()).colwise().sum().minCoeff();
  EXPECT_GT(least, std::cos(0.5 * EIGEN_PI / 180));
}

TEST(RepairedMesh, WeighsCornerNormalsByAngleNotByHowAFaceWasCut) {
  // A cube's corner looks along its diagonal however its square faces are split into triangles.
  Mesh cube;
  cube.vertices.resize(3, 8);
  for (Eigen::Index i = 0; i < 8; ++i)
    cube.vertices.col(i) = Eigen::Vector3d(i & 1 ? 1 : -1, i & 2 ? 1 : -1, i & 4 ? 1 : -1);
  cube.triangles.resize(3, 12);
  cube.triangles << 0, 0, 4, 4, 0, 0, 2, 2, 0, 0, 1, 1,  //
      3, 2, 5, 7, 1, 5, 6, 7, 4, 6, 3, 7,                //
      1, 3, 7, 6, 5, 4, 7, 3, 6, 2, 7, 5;
  const RepairedMesh result = repaired(cube);
  ASSERT_NEAR(signed_volume(result.mesh), 8, 1e-12);
  for (Eigen::Index i = 0; i < 8; ++i)
    EXPECT_LT((result.mesh.normals.col(i) - result.mesh.vertices.col(i).normalized()).norm(),
              1e-12);
}

TEST(RepairedMesh, DropsNonFiniteVerticesWithTheirTriangles) {
  Mesh sphere = make_sphere(1, 1);
  sphere.vertices(1, 40) = std::numeric_limits<double>::quiet_NaN();
  sphere.vertices(0, 41) = std::numeric_limits<double>::infinity();
  const RepairedMesh result = repaired(sphere);
  EXPECT_EQ(result.repairs.non_finite_vertices, 2);
  EXPECT_TRUE(result.mesh.vertices.allFinite());
  EXPECT_LT(result.mesh.triangles.cols(), sphere.triangles.cols() - 5);
  EXPECT_GT(result.repairs.boundary_edges, 0);
}

TEST(RepairedMesh, LeavesNothingOfAMeshOfNaNs) {
  Mesh sphere = make_sphere(1, 1);
  sphere.vertices.setConstant(std::numeric_limits<double>::quiet_NaN());
  const RepairedMesh result = repaired(sphere);
  EXPECT_EQ(result.mesh.vertices.cols(), 0);
  EXPECT_EQ(result.mesh.triangles.cols(), 0);
  EXPECT_EQ(result.repairs.components, 0);
}

TEST(RepairedMesh, DropsDegenerateAndDuplicateTrianglesAndUnusedVertices) {
  Mesh mesh;
  mesh.vertices.resize(3, 5);
  mesh.vertices << 0, 1, 0, 2, 9,  //
      0, 0, 1, 0, 9,               //
      0, 0, 0, 0, 9;
  mesh.triangles.resize(3, 5);
  mesh.triangles << 0, 1, 0, 0, 0,  //
      1, 2, 1, 1, 1,                //
      2, 0, 3, 1, 7;  // the triangle, itself again, a line, a repeated index, an index too large
  const RepairedMesh result = repaired(mesh);
  EXPECT_EQ(result.mesh.triangles.cols(), 1);
  EXPECT_EQ(result.repairs.duplicate_triangles, 1);
  EXPECT_EQ(result.repairs.degenerate_triangles, 3);
  EXPECT_EQ(result.repairs.unused_vertices, 2);
  EXPECT_EQ(result.repairs.boundary_edges, 3);
}

TEST(RepairedMesh, TurnsAnInsideOutSphereAndItsNormals) {
  Mesh sphere = inside_out(make_sphere(1, 1));
  sphere.normals = -sphere.normals;
  const RepairedMesh result = repaired(sphere);
  EXPECT_TRUE(result.repairs.flipped_orientation);
  EXPECT_EQ(result.repairs.rewound_triangles, 0);
  EXPECT_GT(signed_volume(result.mesh), 4);
  EXPECT_EQ(result.repairs.turned_normals, sphere.vertices.cols());
  EXPECT_GT((result.mesh.normals.array() * result.mesh.vertices.array()).colwise().sum().minCoeff(),
            0.999);
}

TEST(RepairedMesh, JudgesEachPartByItself) {
  const Mesh good = make_sphere(1, 1), bad = inside_out(make_torus(2, 0.5, 1));
  const RepairedMesh result = repaired(joined(good, bad, {10, 0, 0}));
  EXPECT_TRUE(result.repairs.flipped_orientation);
  EXPECT_EQ(result.repairs.components, 2);
  EXPECT_NEAR(signed_volume(result.mesh), signed_volume(good) - signed_volume(bad), 1e-9);
}

TEST(RepairedMesh, RewindsTrianglesThatDisagreeWithTheirNeighbours) {
  Mesh sphere = make_sphere(1, 1);
  for (const Eigen::Index i : {3, 700, 701, 4000})
    std::swap(sphere.triangles(1, i), sphere.triangles(2, i));
  const RepairedMesh result = repaired(without_normals(sphere));
  EXPECT_EQ(result.repairs.rewound_triangles, 4);
  EXPECT_FALSE(result.repairs.flipped_orientation);
  EXPECT_NEAR(signed_volume(result.mesh), signed_volume(make_sphere(1, 1)), 1e-12);
}

TEST(RepairedMesh, KeepsTheSideOfAFlatSheet) {
  const Mesh sheet = inside_out(make_plane(1, 1, 1));
  const RepairedMesh result = repaired(without_normals(sheet));
  EXPECT_FALSE(result.repairs.flipped_orientation);
  EXPECT_NEAR(result.mesh.normals(2, 0), -1, 1e-15);
  EXPECT_EQ(result.repairs.boundary_edges, 4 * 32);
}

TEST(RepairedMesh, CountsAnEdgeOfThreeTrianglesAsNonManifold) {
  Mesh fin;
  fin.vertices.resize(3, 5);
  fin.vertices << 0, 0, 1, -1, 0,  //
      0, 0, 1, 1, -1,              //
      0, 1, 0, 0, 0;
  fin.triangles.resize(3, 3);
  fin.triangles << 0, 0, 0,  //
      1, 1, 1,               //
      2, 3, 4;
  const RepairedMesh result = repaired(fin);
  EXPECT_EQ(result.repairs.non_manifold_edges, 1);
  EXPECT_EQ(result.repairs.boundary_edges, 6);
  EXPECT_EQ(result.mesh.triangles.cols(), 3);
}

TEST(RepairedMesh, KeepsACreaseWhoseNormalsDiffer) {
  const Mesh cylinder = make_cylinder(1, 1, 1);
  EXPECT_EQ(repaired(cylinder).mesh.vertices.cols(), cylinder.vertices.cols());
  EXPECT_EQ(repaired(without_normals(cylinder)).repairs.duplicate_vertices, 2 * 96);
}

TEST(RepairedMesh, FindsInTheScansWhatTheirReadmeStates) {
  const auto folder = test::data_folder();
  if (!folder) GTEST_SKIP() << "LIGHTRIG_DATA names no folder";
  const RepairedMesh bunny = repaired(test::data_mesh(*folder, "bunny"));
  EXPECT_EQ(bunny.mesh.vertices.cols(), 34834);
  EXPECT_EQ(bunny.repairs.boundary_edges, 223);
  EXPECT_EQ(bunny.repairs.components, 1);
  EXPECT_FALSE(bunny.repairs.flipped_orientation || bunny.repairs.computed_normals);
  EXPECT_EQ(repaired(test::data_mesh(*folder, "dragon")).repairs.components, 2);
  const RepairedMesh teapot = repaired(test::data_mesh(*folder, "teapot"));
  EXPECT_EQ(teapot.repairs.components, 3);
  EXPECT_EQ(teapot.repairs.boundary_edges, 96);
}

TEST(Teapot, CoincidesWithAnIndependentTessellationOfThePatches) {
  // Every vertex of the data folder's 6 × 6 tessellation is one of ours, scaled to unit radius.
  const auto folder = test::data_folder();
  if (!folder) GTEST_SKIP() << "LIGHTRIG_DATA names no folder";
  const Mesh theirs = test::data_mesh(*folder, "teapot");
  Mesh ours = tessellate_teapot(6);
  const Eigen::Vector3d centre =
      0.5 * (ours.vertices.rowwise().minCoeff() + ours.vertices.rowwise().maxCoeff());
  ours.vertices.colwise() -= centre;
  ours.vertices /= ours.vertices.colwise().norm().maxCoeff();
  ASSERT_EQ(theirs.vertices.cols(), 1177);
  for (Eigen::Index i = 0; i < theirs.vertices.cols(); ++i) {
    const Eigen::Vector3d p = theirs.vertices.col(i);
    EXPECT_LT((ours.vertices.colwise() - p).colwise().norm().minCoeff(), 1e-5) << p.transpose();
  }
}

}  // namespace
}  // namespace lightrig
