#include <fmt/format.h>

#include <Eigen/Eigenvalues>
#include <Eigen/SVD>
#include <algorithm>
#include <cmath>
#include <iterator>
#include <numbers>

#include "core/brdf_basis.h"
#include "core/candidate_bins.h"
#include "core/mesh_repair.h"
#include "core/planner.h"
#include "core/shapes.h"
#include "study/stability_cases.h"
#include "study/stability_reference.h"

namespace lightrig {

namespace {

/// The cells that 40 distant or near lights show on a mesh, all vertices in view from +z.
CandidateBins cells_seen(const Mesh& mesh, double size, bool distant) {
  SurfacePoints points;
  points.position = mesh.vertices;
  points.normal = mesh.normals;
  points.view = Eigen::Vector3d::UnitZ().replicate(1, mesh.vertices.cols());
  std::vector<LightPosition> lights;
  for (int i = 0; i < 40; ++i) {
    const double a = 0.3 + 0.7 * i, e = 0.2 + 0.03 * i;
    const Eigen::Vector3d d(std::cos(e) * std::cos(a), std::cos(e) * std::sin(a), std::sin(e));
    lights.push_back({distant, distant ? d : Eigen::Vector3d(3 * size * d)});
  }
  const Occluder occluder(mesh);
  return bin_candidates(points, lights, {}, {}, GrazingLimits{}, occluder, ShadowRays::needed, 1)
      .bins;
}

/// Cells that lights straight and nearly straight behind a ball show.
double cells_from_behind(bool distant) {
  const Mesh ball = make_sphere(1.0, 1);
  SurfacePoints points;
  points.position = ball.vertices;
  points.normal = ball.normals;
  points.view = Eigen::Vector3d::UnitZ().replicate(1, ball.vertices.cols());
  std::vector<LightPosition> lights;
  for (const double aside : {0.0, 1e-12, 1e-3}) {
    const Eigen::Vector3d d = Eigen::Vector3d(aside, 0, -1).normalized();
    lights.push_back({distant, distant ? d : Eigen::Vector3d(3 * d)});
  }
  const Occluder occluder(ball);
  return static_cast<double>(
      bin_candidates(points, lights, {}, {}, GrazingLimits{}, occluder, ShadowRays::needed, 1)
          .bins.cell.size());
}

/// Points of the ball that a half vector above their horizon is enough for, whether or not they
/// face the light.
double points_by_half_vector(bool distant) {
  const Mesh ball = make_sphere(1.0, 1);
  double count = 0;
  for (const double aside : {0.0, 1e-12, 1e-3}) {
    const Eigen::Vector3d d = Eigen::Vector3d(aside, 0, -1).normalized();
    for (Eigen::Index i = 0; i < ball.vertices.cols(); ++i) {
      const Eigen::Vector3d n = ball.normals.col(i), v = Eigen::Vector3d::UnitZ();
      const Eigen::Vector3d l = distant ? d : (3 * d - ball.vertices.col(i)).normalized();
      count += n.dot(v) > 0 && n.dot((l + v).normalized()) > 0 ? 1 : 0;
    }
  }
  return count;
}

/// No vertex above any face, to the last bit.
bool naive_convex(const Mesh& mesh) {
  for (Eigen::Index t = 0; t < mesh.triangles.cols(); ++t) {
    const Eigen::Matrix3d p = mesh.vertices(Eigen::all, mesh.triangles.col(t));
    const Eigen::Vector3d normal = (p.col(1) - p.col(0)).cross(p.col(2) - p.col(0)).normalized();
    const Eigen::Matrix3Xd from_face = mesh.vertices.colwise() - p.col(0);
    if ((normal.transpose() * from_face).maxCoeff() > 0) return false;
  }
  return true;
}

/// |QᵀQ − I| of classical Gram-Schmidt over the columns.
double naive_orthonormality(Eigen::MatrixXd Q) {
  for (Eigen::Index j = 0; j < Q.cols(); ++j) {
    const Eigen::VectorXd column = Q.col(j);
    for (Eigen::Index i = 0; i < j; ++i) Q.col(j) -= Q.col(i).dot(column) * Q.col(i);
    Q.col(j).normalize();
  }
  return (Q.transpose() * Q - Eigen::MatrixXd::Identity(Q.cols(), Q.cols())).norm();
}

/// How many cells a light shows in only one of two.
double differences(const CandidateBins& a, const CandidateBins& b) {
  double count = 0;
  for (int light = 0; light < a.candidates(); ++light) {
    std::vector<std::int32_t> only;
    std::ranges::set_symmetric_difference(a.of(light), b.of(light), std::back_inserter(only));
    count += static_cast<double>(only.size());
  }
  return count;
}

/// The cells that three lights show on a ball: by planning, by angles of a hundred digits, and by
/// arc cosines in single precision, as a renderer might have them.
struct CellsOfBall {
  CandidateBins ours, reference, naive;
};
CellsOfBall cells_of_ball(double size, bool distant) {
  const Mesh ball = make_sphere(size, 1);
  const Eigen::Vector3d view = Eigen::Vector3d::UnitZ();
  const GrazingLimits limits;
  SurfacePoints points;
  const Eigen::Index n = ball.vertices.cols();
  points.position = ball.vertices;
  points.normal = ball.normals;
  points.view = view.replicate(1, n);
  const BivariateGrid grid;
  CellsOfBall cells{{grid, {0}, {}}, {grid, {0}, {}}, {grid, {0}, {}}};
  const auto add = [](CandidateBins& bins, std::vector<std::int32_t> shown) {
    std::ranges::sort(shown);
    const auto repeated = std::ranges::unique(shown);
    bins.cell.insert(bins.cell.end(), shown.begin(), repeated.begin());
    bins.offset.push_back(static_cast<std::int64_t>(bins.cell.size()));
  };
  const auto cell = [&](double theta_h, double theta_d) {
    const double quarter = std::numbers::pi / 2;
    const int h = static_cast<int>(std::sqrt(theta_h / quarter) * grid.n_h);
    const int d = static_cast<int>(theta_d / quarter * grid.n_d);
    return grid.cell(std::min(h, grid.n_h - 1), std::min(d, grid.n_d - 1));
  };
  std::vector<LightPosition> lights;
  for (int i = 0; i < 3; ++i) {
    // A half vector within a millionth of a vertex's normal: the narrowest cells are about it.
    Eigen::Index vertex = 0;
    (ball.normals.transpose() * Eigen::Vector3d(0.3 * i, 0.2 - 0.1 * i, 1)).maxCoeff(&vertex);
    const Eigen::Vector3d half =
        (ball.normals.col(vertex) + Eigen::Vector3d(1e-6, 0, 0)).normalized();
    const Eigen::Vector3d d = 2 * half.dot(view) * half - view;
    lights.push_back({distant, distant ? d.normalized() : Eigen::Vector3d(3 * size * d)});
    std::vector<std::int32_t> reference, naive;
    for (Eigen::Index k = 0; k < n; ++k) {
      const Eigen::Vector3d normal = points.normal.col(k),
                            way = distant ? d : lights.back().p - points.position.col(k);
      const double cos_i = normal.dot(way) / way.norm();
      if (cos_i < limits.min_cos_i || normal.dot(view) < limits.min_cos_o) continue;
      const ReferenceAngles exact = reference_angles(normal, way, view);
      if (exact.theta_d <= limits.max_theta_d)
        reference.push_back(cell(exact.theta_h, exact.theta_d));
      const Eigen::Vector3f l = way.cast<float>().normalized(), v = view.cast<float>();
      const Eigen::Vector3f h = (l + v).normalized();
      const float theta_h = std::acos(std::min(1.0F, normal.cast<float>().dot(h)));
      const float theta_d = std::acos(std::min(1.0F, l.dot(h)));
      if (double{theta_d} <= limits.max_theta_d) naive.push_back(cell(theta_h, theta_d));
    }
    add(cells.reference, std::move(reference));
    add(cells.naive, std::move(naive));
  }
  cells.ours =
      bin_candidates(points, lights, grid, {}, limits, Occluder(ball), ShadowRays::needed, 1).bins;
  return cells;
}

Material material_of(const char* name, const BivariateGrid& grid, double scale, double fall) {
  Material material{name, "", "", {grid, Eigen::ArrayXXd(grid.cells(), 1)}};
  for (int c = 0; c < grid.cells(); ++c) {
    material.table.f(c, 0) = scale * std::exp(-fall * grid.row_h(c));
  }
  return material;
}

}  // namespace

std::vector<StabilityCase> geometry_cases() {
  std::vector<StabilityCase> cases;
  const Mesh unit = make_torus(1.0, 0.4, 1);
  for (const bool distant : {true, false}) {
    const CandidateBins expected = cells_seen(unit, 1, distant);
    // Other sizes round a coordinate by ε. An angle crosses a threshold of its grid by that for one
    // in 1e12 of the 1e5 pairs of light and vertex; a shadow ray, single precision of the object's
    // size (6e-8), passes so near one of the few outlines that shade for one in 1e6 of them; and a
    // cell changes only where no other vertex shows it. One cell at most, so.
    const double expected_size = static_cast<double>(expected.cell.size());
    // Powers of two change no digit of a coordinate: every cell must be the same.
    for (const int power : {-13, 10}) {
      const double size = std::ldexp(1.0, power);
      Mesh scaled = unit;
      scaled.vertices *= size;
      const CandidateBins found = cells_seen(scaled, size, distant);
      cases.push_back(judged("geometry",
                             fmt::format("a torus of {:.1e} m, {} lamp: cells that differ", size,
                                         distant ? "distant" : "near"),
                             0, differences(expected, found), no_naive, 0));
    }
    for (const double size : {1e-4, 1e3}) {
      Mesh scaled = unit;
      scaled.vertices *= size;
      const double in_common =
          expected_size - differences(expected, cells_seen(scaled, size, distant));
      cases.push_back(judged("geometry",
                             fmt::format("a torus of {:.0e} m, {} lamp: cells in common", size,
                                         distant ? "distant" : "near"),
                             expected_size, in_common, no_naive, 1 / expected_size));
    }
  }
  for (const bool distant : {true, false}) {
    for (const double size : {1e-4, 1.0, 1e3}) {
      const CellsOfBall cells = cells_of_ball(size, distant);
      const auto shown = static_cast<double>(cells.reference.cell.size());
      cases.push_back(judged("geometry",
                             fmt::format("a ball of {:.0e} m, {} lamp: cells of exact angles", size,
                                         distant ? "distant" : "near"),
                             shown, shown - differences(cells.reference, cells.ours),
                             shown - differences(cells.reference, cells.naive), 0));
    }
  }
  const Mesh plane = make_plane(1.0, 1.0, 4);
  cases.push_back(judged("geometry", "a true plane: each of 40 distant lights shows one cell", 40,
                         static_cast<double>(cells_seen(plane, 1, true).cell.size()), no_naive, 0));
  for (const bool distant : {true, false}) {
    cases.push_back(
        judged("geometry",
               fmt::format("{} lights behind the object: no cell", distant ? "distant" : "near"), 0,
               cells_from_behind(distant), points_by_half_vector(distant), 0));
  }
  Mesh broken = make_sphere(1.0, 1);
  const Eigen::Index t = broken.triangles.cols(), v = broken.vertices.cols();
  broken.vertices.conservativeResize(3, v + 2);
  broken.normals.conservativeResize(3, v + 2);
  broken.vertices.col(v).setConstant(std::nan(""));
  broken.vertices.col(v + 1) = Eigen::Vector3d(0, 0, 3);
  broken.normals.rightCols(2).setZero();
  broken.triangles.conservativeResize(3, t + 4);
  const int n = static_cast<int>(v);
  broken.triangles.col(t) = broken.triangles.col(0);       // duplicated
  broken.triangles.col(t + 1) = Eigen::Vector3i(0, 0, 1);  // degenerate
  broken.triangles.col(t + 2) = Eigen::Vector3i(0, 1, n);  // not a number
  broken.triangles.col(t + 3) =
      Eigen::Vector3i(broken.triangles(0, 0), broken.triangles(1, 0), n + 1);  // a fin
  const RepairedMesh mended = repaired(broken);
  const double as_they_come = 0;  // a loader that takes what is there drops and says nothing
  cases.push_back(judged("geometry", "degenerate triangles dropped", 1,
                         mended.repairs.degenerate_triangles, as_they_come, 0));
  cases.push_back(judged("geometry", "duplicated triangles dropped", 1,
                         mended.repairs.duplicate_triangles, as_they_come, 0));
  cases.push_back(judged("geometry", "vertices that are not numbers dropped", 1,
                         mended.repairs.non_finite_vertices, as_they_come, 0));
  cases.push_back(judged("geometry", "non-manifold edges said", 1,
                         mended.repairs.non_manifold_edges, as_they_come, 0));
  cases.push_back(judged("geometry", "a body with a fin is not taken for convex", 0,
                         Occluder(mended.mesh).convex() ? 1 : 0, naive_convex(mended.mesh) ? 1 : 0,
                         0));
  const Mesh ball = make_sphere(1.0, 1);
  cases.push_back(judged("geometry", "a ball is", 1, Occluder(ball).convex() ? 1 : 0,
                         naive_convex(ball) ? 1 : 0, 0));
  Mesh degenerate = ball;
  degenerate.triangles.row(2) = degenerate.triangles.row(1);
  cases.push_back(judged(
      "geometry", "rays against nothing but degenerate triangles: none blocked", 0,
      Occluder(degenerate).blocked({0, 0, 1}, {0, 0, 1}, {true, {0, 0, 1}}) ? 1 : 0, no_naive, 0));
  return cases;
}

std::vector<StabilityCase> material_cases() {
  std::vector<StabilityCase> cases;
  const BivariateGrid grid{12, 6};
  std::vector<Material> materials = {
      material_of("mirror-like", grid, 1e8, 8.0), material_of("diffuse", grid, 0.3, 0.0),
      material_of("black", grid, 1e-9, 0.1),      material_of("range 1e12", grid, 1e4, 2.6),
      material_of("glossy", grid, 10.0, 0.5),
  };
  materials[2].table.f(3, 0) = 0;
  materials[2].table.f(4, 0) = 5e-324;  // the least denormal
  materials[1].table.f(7, 0) = std::nan("");
  materials[4].table.f(8, 0) = -1;
  BasisOptions options;
  options.sigma_folds = 0;
  const Result<BrdfBasis> basis = make_basis(materials, options);
  cases.push_back(
      judged("materials", "extreme values: a basis is made", 1, basis ? 1 : 0, no_naive, 0));
  if (!basis) return cases;
  Eigen::ArrayXXd plain_log(grid.cells(), static_cast<Eigen::Index>(materials.size()));
  for (std::size_t m = 0; m < materials.size(); ++m)
    plain_log.col(static_cast<Eigen::Index>(m)) = materials[m].table.f.col(0).log();
  cases.push_back(judged("materials", "and all of it is finite", 1,
                         basis->V.allFinite() && basis->mean.allFinite() ? 1 : 0,
                         plain_log.isFinite().all() ? 1 : 0, 0));
  cases.push_back(judged("materials", "a cell that is not a number is masked", 0, basis->valid[7],
                         1, 0));  // a table is taken as it comes
  const Eigen::Index k = basis->components();
  // All materials about their mean: one column more than their rank.
  Eigen::MatrixXd logs = plain_log.isFinite().select(plain_log, std::log(options.floor)).matrix();
  logs.colwise() -= Eigen::VectorXd(logs.rowwise().mean());
  const Eigen::BDCSVD<Eigen::MatrixXd> svd(logs);
  const Eigen::MatrixXd VtV = basis->V.transpose() * basis->V;
  cases.push_back(judged("materials", "components orthonormal: |V'V - I| + 1", 1,
                         1 + (VtV - Eigen::MatrixXd::Identity(k, k)).norm(),
                         1 + naive_orthonormality(logs), 1e-12));
  cases.push_back(judged("materials", "ln of 0 is ln of the floor", std::log(options.floor),
                         map_value(basis->mapping, 3, 0.0), std::log(0.0), 0));
  cases.push_back(judged("materials", "K = materials - 1", 4, static_cast<double>(k),
                         static_cast<double>((svd.singularValues().array() > 0).count()), 0));
  CandidateBins bins{grid, {0}, {}};
  for (int c = 0; c < grid.cells() / 2; ++c) {
    if (basis->valid[static_cast<std::size_t>(c)] != 0) bins.cell.push_back(c);
  }
  bins.offset.push_back(static_cast<std::int64_t>(bins.cell.size()));
  Eigen::MatrixXd G(static_cast<Eigen::Index>(bins.cell.size()), k);
  for (Eigen::Index r = 0; r < G.rows(); ++r) {
    G.row(r) = basis->V.row(basis->row(bins.cell[static_cast<std::size_t>(r)], 0));
  }
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> eigen(G.transpose() * G);
  cases.push_back(judged("materials", "K = materials - 1: condition of half the table",
                         reference_condition(G).condition,
                         conditioning(*basis, bins, std::vector<int>{0}).condition,
                         eigen.eigenvalues()[k - 1] / eigen.eigenvalues()[0], 1e-9));
  // Coefficients far outside the training range: exponents are clipped, and counted.
  int clipped = 0;
  const BrdfTable wild = evaluate(*basis, Eigen::MatrixXd::Constant(k, 1, 1e6), &clipped);
  const bool finite = (wild.f.isFinite() || wild.f.isNaN()).all();
  const Eigen::VectorXd exponents = basis->V * Eigen::VectorXd::Constant(k, 1e6) + basis->mean;
  cases.push_back(judged("materials", "exp of a wild reconstruction does not overflow", 1,
                         finite && clipped > 0 ? 1 : 0,
                         exponents.array().exp().isFinite().all() ? 1 : 0, 0));
  return cases;
}

}  // namespace lightrig
