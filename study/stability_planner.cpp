#include <fmt/format.h>
#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <Eigen/QR>
#include <algorithm>
#include <cmath>
#include <iterator>
#include <numbers>
#include <random>
#include <utility>
#include <vector>

#include "core/half_diff.h"
#include "core/planner.h"
#include "core/planner_kernels.h"
#include "study/stability_cases.h"
#include "study/stability_reference.h"

namespace lightrig {

namespace {

constexpr double infinity = std::numeric_limits<double>::infinity();

Eigen::MatrixXd orthonormal(std::mt19937_64& random, Eigen::Index rows, Eigen::Index columns) {
  std::normal_distribution<double> normal;
  Eigen::MatrixXd A(rows, columns);
  for (double& a : A.reshaped()) a = normal(random);
  const Eigen::HouseholderQR<Eigen::MatrixXd> qr(A);
  return qr.householderQ() * Eigen::MatrixXd::Identity(rows, columns);
}

/// A basis whose V is the matrix given, one row per cell, a column of cells.
BrdfBasis basis_of(const Eigen::MatrixXd& V) {
  BrdfBasis basis;
  basis.grid = {static_cast<int>(V.rows()), 1};
  basis.layout = ChannelLayout::columns;
  basis.valid.assign(static_cast<std::size_t>(V.rows()), 1);
  basis.V = V;
  basis.mean = Eigen::VectorXd::Constant(V.rows(), -2.0);
  basis.stddev = Eigen::VectorXd::LinSpaced(V.cols(), 3.0, 1.0);
  return basis;
}

CandidateBins bins_of(const BivariateGrid& grid, const std::vector<std::vector<std::int32_t>>& of) {
  CandidateBins bins;
  bins.grid = grid;
  bins.offset.push_back(0);
  for (const auto& cells : of) {
    bins.cell.insert(bins.cell.end(), cells.begin(), cells.end());
    bins.offset.push_back(static_cast<std::int64_t>(bins.cell.size()));
  }
  return bins;
}

std::vector<std::int32_t> range(int first, int last) {
  std::vector<std::int32_t> cells;
  for (int c = first; c < last; ++c) cells.push_back(c);
  return cells;
}

double naive_condition(const Eigen::MatrixXd& G) {
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> eigen(G.transpose() * G,
                                                             Eigen::EigenvaluesOnly);
  return eigen.eigenvalues()[G.cols() - 1] / eigen.eigenvalues()[0];
}

/// Trace of the posterior over coefficients of unit prior and noise.
double naive_trace(const Eigen::MatrixXd& G) {
  return (Eigen::MatrixXd::Identity(G.cols(), G.cols()) + G.transpose() * G).inverse().trace();
}

/// Eigenvalues of GᵀG that are not zero.
double naive_rank(const Eigen::MatrixXd& G) {
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> eigen(G.transpose() * G,
                                                             Eigen::EigenvaluesOnly);
  return static_cast<double>((eigen.eigenvalues().array() != 0).count());
}

/// 30 rows whose singular values fall evenly to 1/√kappa2.
Eigen::MatrixXd graded(std::uint64_t seed, Eigen::Index rows, Eigen::Index k, double kappa2) {
  std::mt19937_64 random(seed);
  Eigen::VectorXd s(k);
  for (Eigen::Index i = 0; i < k; ++i) {
    s[i] = std::pow(kappa2, -0.5 * static_cast<double>(i) /
                                static_cast<double>(std::max<Eigen::Index>(1, k - 1)));
  }
  const Eigen::MatrixXd U = orthonormal(random, rows, k), P = orthonormal(random, k, k);
  return U * s.asDiagonal() * P.transpose();
}

Selection select(const BrdfBasis& basis, const CandidateBins& bins, bool brute = false,
                 Criterion criterion = Criterion::condition) {
  SelectionOptions options;
  options.criterion = criterion;
  options.stop = StopRule::count;
  options.max_lights = 5;
  options.brute_force = brute;
  return select_lights(basis, bins, options);
}

double count_of(const Selection& selection) { return static_cast<double>(selection.lights.size()); }

}  // namespace

std::vector<StabilityCase> condition_cases() {
  std::vector<StabilityCase> cases;
  const auto add = [&](int power, int rows, int k) {
    const double kappa2 = std::pow(10.0, power);
    const Eigen::MatrixXd G = graded(static_cast<std::uint64_t>(power), rows, k, kappa2);
    const BrdfBasis basis = basis_of(G);
    // Two lights that share the rows: the value is the one of a plan, carried from light to light.
    const CandidateBins bins =
        bins_of(basis.grid, {range(0, 3 * rows / 5), range(3 * rows / 5, rows)});
    const Selection plan = select(basis, bins);
    // Beyond 1e13 rounding of the rows themselves is amplified by κ: only then is more allowed.
    const double tolerance = power <= 13 ? 1e-9 : 1e-15 * std::sqrt(kappa2) * 10;
    cases.push_back(judged(
        "condition", fmt::format("kappa2 1e{} of {} rows, {} components", power, rows, k),
        reference_condition(G).condition, plan.lights.empty() ? 0 : plan.lights.back().condition,
        naive_condition(G), tolerance));
  };
  for (const int power : {1, 3, 5, 7, 9, 11, 13, 15, 17, 20, 22}) add(power, 30, 10);
  for (const int power : {13, 20}) add(power, 90, 45);
  for (const int power : {30, 34}) {
    const Eigen::MatrixXd G =
        graded(static_cast<std::uint64_t>(power), 30, 10, std::pow(10.0, power));
    const BrdfBasis basis = basis_of(G);
    const CandidateBins bins = bins_of(basis.grid, {range(0, 30)});
    // Smaller than the rounding of the rows: the verdict is a loss of rank, never a number.
    cases.push_back(judged("condition", fmt::format("kappa2 1e{}: beyond double precision", power),
                           infinity, conditioning(basis, bins, std::vector<int>{0}).condition,
                           naive_condition(G), 0));
  }
  Eigen::MatrixXd twin = graded(7, 30, 10, 100);
  twin.col(3) = twin.col(4);
  const BrdfBasis basis = basis_of(twin);
  const CandidateBins bins = bins_of(basis.grid, {range(0, 30)});
  cases.push_back(judged("condition", "two equal components: rank 9 of 10", 9,
                         conditioning(basis, bins, std::vector<int>{0}).rank, naive_rank(twin), 0));
  cases.push_back(judged("condition", "two equal components: infinite, not negative",
                         reference_condition(twin).condition,
                         conditioning(basis, bins, std::vector<int>{0}).condition,
                         naive_condition(twin), 0));
  return cases;
}

namespace {

/// Energies of cells, and their sums, must not depend on the order that the cells come in.
std::vector<StabilityCase> order_cases() {
  const Eigen::MatrixXd G = graded(13, 301, 10, 1e13);
  PackedRows rows;
  rows.k = 10;
  rows.stride = 16;
  rows.data.assign(301 * 16, 0.0);
  for (Eigen::Index r = 0; r < 301; ++r) {
    for (Eigen::Index j = 0; j < 10; ++j) rows.data[static_cast<std::size_t>(16 * r + j)] = G(r, j);
  }
  std::vector<double> x(16, 0.0), y(16, 0.0), of_x(301), of_y(301), first(301, -1.0);
  for (std::size_t j = 0; j < 10; ++j) {
    x[j] = std::sin(1.0 + static_cast<double>(j));
    y[j] = std::cos(static_cast<double>(j));
  }
  std::vector<std::int32_t> cells = range(0, 301);
  std::mt19937_64 random(17);
  double differ = 0, least = infinity, greatest = 0;
  for (int round = 0; round < 50; ++round) {
    cell_energies(rows, cells, x, y, of_x, of_y, vector_level());
    double sum = 0;
    for (std::size_t i = 0; i < cells.size(); ++i) {
      double& known = first[static_cast<std::size_t>(cells[i])];
      if (round == 0) known = of_x[i];
      differ += known != of_x[i] ? 1 : 0;
      sum += of_x[i];
    }
    least = std::min(least, sum);
    greatest = std::max(greatest, sum);
    std::shuffle(cells.begin(), cells.end(), random);
  }
  return {judged("condition", "energies of 301 cells in 50 orders: how many differ", 0, differ,
                 no_naive, 0),
          judged("condition", "their sums in 50 orders: greatest against least", least, greatest,
                 no_naive, 1e-13)};
}

}  // namespace

std::vector<StabilityCase> posterior_cases() {
  std::vector<StabilityCase> cases;
  for (const double sigma : {1.0, 1e-3, 1e-6}) {
    for (const double spread : {1e0, 1e-4, 1e-8}) {
      const Eigen::MatrixXd G = graded(11, 24, 8, 1e8);
      BrdfBasis basis = basis_of(G);
      for (Eigen::Index i = 0; i < 8; ++i) {
        basis.stddev[i] = 10 * std::pow(spread, static_cast<double>(i) / 7.0);
      }
      SelectionOptions options;
      options.criterion = Criterion::a_optimal;
      options.sigma = sigma;
      options.max_lights = 1;
      const Selection plan = select_lights(basis, bins_of(basis.grid, {range(0, 24)}), options);
      const Eigen::MatrixXd prior = basis.stddev.cwiseAbs2().cwiseInverse().asDiagonal();
      const Eigen::MatrixXd naive = (prior + G.transpose() * G / (sigma * sigma)).inverse();
      cases.push_back(judged(
          "posterior", fmt::format("trace, noise {:.0e}, prior spread {:.0e}", sigma, spread),
          reference_posterior_trace(basis.stddev, G, sigma),
          plan.lights.empty() ? 0 : plan.lights[0].score, naive.trace(),
          // The information's own condition number is (s/σ)²: digits that no sum of doubles has.
          sigma >= 1 ? 1e-12 : (sigma >= 1e-3 ? 1e-8 : 1e-5)));
    }
  }
  return cases;
}

std::vector<StabilityCase> angle_cases() {
  std::vector<StabilityCase> cases;
  const Eigen::Vector3d n = Eigen::Vector3d::UnitZ();
  for (const double e : {1e-3, 1e-6, 1e-8, 1e-10, 1e-12}) {
    const Eigen::Vector3d v(std::sin(2 * e), 0, std::cos(2 * e));
    const ReferenceAngles reference = reference_angles(n, n, v);
    const HalfDiff angles = half_diff(n, n, v);
    const Eigen::Vector3d h = (n + v).normalized();
    cases.push_back(judged("angles", fmt::format("theta_h of {:.0e} rad", e), reference.theta_h,
                           angles.theta_h, std::acos(std::min(1.0, n.dot(h))),
                           std::max(1e-9, 1e-15 / e)));
    cases.push_back(judged("angles", fmt::format("theta_d of {:.0e} rad", e), reference.theta_d,
                           angles.theta_d, std::acos(std::min(1.0, n.dot(h))), 1e-9));
  }
  for (const double e : {1e-3, 1e-6, 1e-9, 1e-12}) {
    const Eigen::Vector3d l(std::cos(e), 0, std::sin(e)), v(-std::cos(e), 0, std::sin(e));
    const ReferenceAngles reference = reference_angles(n, l, v);
    const HalfDiff angles = half_diff(n, l, v);
    const double half_pi = std::numbers::pi / 2;
    const Eigen::Vector3d h = (l + v).normalized();
    cases.push_back(judged("angles", fmt::format("theta_d {:.0e} rad short of 90 deg", e),
                           reference.theta_d, angles.theta_d, std::acos(l.dot(h)), 1e-15));
    cases.push_back(judged("angles",
                           fmt::format("{:.0e} rad short of 90 deg: the distance itself", e),
                           half_pi - reference.theta_d, half_pi - angles.theta_d,
                           half_pi - std::acos(l.dot(h)), std::max(1e-12, 3e-16 / e)));
  }
  return cases;
}

namespace {

/// The greedy choice of `count` lights as `score` of their rows has it; smallest index on ties.
template <class Score>
std::vector<int> greedy(const Eigen::MatrixXd& V, const std::vector<std::vector<std::int32_t>>& of,
                        int count, const Score& score) {
  std::vector<int> chosen;
  std::vector<std::int32_t> cells;
  while (static_cast<int>(chosen.size()) < count) {
    double best = infinity;
    std::vector<std::int32_t> best_cells;
    int light = -1;
    for (int i = 0; i < static_cast<int>(of.size()); ++i) {
      std::vector<std::int32_t> with;
      std::ranges::set_union(cells, of[static_cast<std::size_t>(i)], std::back_inserter(with));
      if (with.size() == cells.size()) continue;
      const double value = score(V(with, Eigen::all));
      if (!(value < best)) continue;
      best = value;
      best_cells = std::move(with);
      light = i;
    }
    chosen.push_back(light);
    cells = std::move(best_cells);
  }
  return chosen;
}

/// The loop as first written: as many lights as there are, whatever they add, and the least score
/// as numpy's argmin finds it, to which what is no number is the least.
std::vector<int> plain_loop(const Eigen::MatrixXd& V,
                            const std::vector<std::vector<std::int32_t>>& of,
                            double (*score)(const Eigen::MatrixXd&)) {
  std::vector<int> chosen;
  std::vector<std::int32_t> cells;
  while (chosen.size() < of.size()) {
    double best = infinity;
    std::vector<std::int32_t> best_cells;
    int light = -1;
    for (int i = 0; i < static_cast<int>(of.size()); ++i) {
      if (std::ranges::count(chosen, i) > 0) continue;
      std::vector<std::int32_t> with;
      std::ranges::set_union(cells, of[static_cast<std::size_t>(i)], std::back_inserter(with));
      const double value = score(V(with, Eigen::all));
      if (light >= 0 && (std::isnan(best) || value >= best)) continue;
      best = value;
      best_cells = std::move(with);
      light = i;
    }
    chosen.push_back(light);
    cells = std::move(best_cells);
  }
  return chosen;
}

/// Which lights are chosen where every choice is stiff: twelve that show 20 of 60 rows each, each
/// of them twice, and four short of rank, whose naive ratio may be negative and so the least.
std::vector<StabilityCase> choice_cases() {
  std::vector<StabilityCase> cases;
  for (const int power : {7, 13, 17, 20}) {
    std::mt19937_64 random(static_cast<std::uint64_t>(power));
    const BrdfBasis basis =
        basis_of(graded(static_cast<std::uint64_t>(power) + 100, 60, 10, std::pow(10.0, power)));
    std::vector<std::vector<std::int32_t>> of;
    std::vector<std::int32_t> cells = range(0, 60);
    for (int i = 0; i < 16; ++i) {
      std::shuffle(cells.begin(), cells.end(), random);
      of.emplace_back(cells.begin(), cells.begin() + (i < 4 ? 6 : 20));
      std::ranges::sort(of.back());
    }
    for (std::size_t i = 4; i < 16; ++i) of.push_back(of[i]);
    const std::vector<int> reference = greedy(basis.V, of, 3, [](const Eigen::MatrixXd& G) {
      return G.rows() < G.cols() ? infinity : reference_condition(G).condition;
    });
    const std::vector<int> naive = greedy(basis.V, of, 3, naive_condition);
    const Selection plan = select(basis, bins_of(basis.grid, of));
    double differ = 0, naive_differs = 0;
    for (std::size_t i = 0; i < reference.size(); ++i) {
      differ += plan.lights.at(i).candidate != reference[i] ? 1 : 0;
      naive_differs += naive[i] != reference[i] ? 1 : 0;
    }
    cases.push_back(judged("planner",
                           fmt::format("28 lights at kappa2 1e{}: choices of 3 that differ", power),
                           0, differ, naive_differs, 0));
  }
  return cases;
}

}  // namespace

std::vector<StabilityCase> planner_cases() {
  std::vector<StabilityCase> cases = order_cases();
  for (StabilityCase& choice : choice_cases()) cases.push_back(std::move(choice));
  const BrdfBasis basis = basis_of(graded(3, 40, 8, 1e4));
  for (const Criterion criterion : {Criterion::condition, Criterion::a_optimal}) {
    const bool kappa = criterion == Criterion::condition;
    const auto add = [&](const char* name, double reference, double value,
                         std::optional<double> naive = no_naive) {
      cases.push_back(judged("planner",
                             fmt::format("{}: {}", kappa ? "condition" : "a-optimal", name),
                             reference, value, naive, 0));
    };
    const auto plan = [&](const std::vector<std::vector<std::int32_t>>& cells) {
      return select(basis, bins_of(basis.grid, cells), false, criterion);
    };
    const auto plain = [&](const std::vector<std::vector<std::int32_t>>& cells) {
      return plain_loop(basis.V, cells, kappa ? naive_condition : naive_trace);
    };
    add("no candidate: no light", 0, count_of(plan({})), double(plain({}).size()));
    const std::vector<std::vector<std::int32_t>> nothing(3), alike(3, range(0, 20));
    add("candidates that see nothing: no light", 0, count_of(plan(nothing)),
        double(plain(nothing).size()));
    add("all lights alike: one is taken", 1, count_of(plan(alike)), double(plain(alike).size()));
    add("all lights alike: the first", 0, plan(alike).lights.at(0).candidate, plain(alike).at(0));
    const Selection point = plan({{5}, {}, {5}});
    add("one point: rank 1", 1, point.lights.at(0).rank, naive_rank(basis.V.row(5)));
    add("one point: infinite condition", infinity, point.lights.at(0).condition,
        naive_condition(basis.V.row(5)));
    const Selection plane = plan({{1}, {2}, {3}, {4}, {1}});
    add("a plane, one cell per light: rank grows by one each", 4, plane.lights.back().rank,
        naive_rank(basis.V.middleRows(1, 4)));
    const Selection few = plan({range(0, 3), range(3, 6)});
    add("6 rows for 8 components: rank 6", 6, few.lights.back().rank,
        naive_rank(basis.V.topRows(6)));
    add("6 rows for 8 components: infinite condition", infinity, few.lights.back().condition,
        naive_condition(basis.V.topRows(6)));
  }
  for (const Eigen::Index k : {1, 39}) {
    const BrdfBasis edge = basis_of(graded(5, 40, k, 1e6));
    const CandidateBins bins = bins_of(edge.grid, {range(0, 40), range(0, 20)});
    const Selection plan = select(edge, bins);
    cases.push_back(judged("planner", fmt::format("{} component(s) of 40 rows", k),
                           reference_condition(edge.V).condition, plan.lights.at(0).condition,
                           naive_condition(edge.V), 1e-9));
  }
  // Rows so small or large that squares leave the range of doubles' comfort.
  for (const double scale : {1e-120, 1e120}) {
    const BrdfBasis edge = basis_of(scale * graded(6, 30, 6, 1e4));
    const Selection plan = select(edge, bins_of(edge.grid, {range(0, 30)}));
    cases.push_back(judged("planner", fmt::format("rows scaled by {:.0e}", scale),
                           reference_condition(edge.V).condition, plan.lights.at(0).condition,
                           naive_condition(edge.V), 1e-9));
  }
  const Selection fast =
      select(basis, bins_of(basis.grid, {range(0, 9), range(4, 30), range(9, 40)}));
  const Selection brute =
      select(basis, bins_of(basis.grid, {range(0, 9), range(4, 30), range(9, 40)}), true);
  cases.push_back(judged("planner", "brute force and bounds give one condition number",
                         brute.lights.back().condition, fast.lights.back().condition,
                         naive_condition(basis.V), 1e-9));
  return cases;
}

}  // namespace lightrig
