#include <Eigen/Cholesky>
#include <cmath>
#include <limits>
#include <random>

#include "core/fit.h"
#include "study/stability_cases.h"
#include "study/stability_reference.h"

namespace lightrig {

namespace {

constexpr double nan = std::numeric_limits<double>::quiet_NaN();
constexpr double infinity = std::numeric_limits<double>::infinity();
constexpr double denormal = 5e-324;  // the least there is
constexpr double model_sigma = 0.15;

/// Thirty cells, five components, the logarithm with a floor.
BrdfBasis little_basis() {
  std::mt19937_64 random(19);
  std::normal_distribution<double> normal;
  BrdfBasis basis;
  basis.grid = {30, 1};
  basis.layout = ChannelLayout::columns;
  basis.valid.assign(30, 1);
  basis.V = Eigen::MatrixXd::NullaryExpr(30, 5, [&] { return normal(random) / 5; });
  basis.mean = Eigen::VectorXd::Constant(30, -2.0);
  basis.stddev = Eigen::VectorXd::LinSpaced(5, 6.0, 0.5);
  basis.model_sigma = model_sigma;
  return basis;
}

/// One measured row per cell.
struct Row {
  double f, variance;
};

/// The coefficient that is furthest from a hundred digits' arithmetic, beside what that says, and
/// what ln f as it is and the normal equations make of it. A row whose numbers are none, or whose
/// variance is infinite, says nothing; f at or below the floor is the floor.
StabilityCase fit_case(const char* name, const std::vector<Row>& rows, Estimator estimator) {
  const BrdfBasis basis = little_basis();
  BrdfObservations seen;
  std::vector<Eigen::Index> kept;
  for (std::size_t i = 0; i < rows.size(); ++i) {
    BrdfObservation o;
    o.cell = static_cast<std::int32_t>(i);
    o.count = 1;
    o.f = rows[i].f;
    o.variance = rows[i].variance;
    seen.rows.push_back(o);
    if (std::isfinite(o.f) && std::isfinite(o.variance)) kept.push_back(o.cell);
  }
  const bool map = estimator == Estimator::map;
  const auto m = static_cast<Eigen::Index>(kept.size());
  Eigen::MatrixXd G(m, 5), raw(static_cast<Eigen::Index>(rows.size()), 5);
  Eigen::VectorXd f(m), noise(m), plain(raw.rows());
  for (Eigen::Index i = 0; i < m; ++i) {
    const Eigen::Index cell = kept[static_cast<std::size_t>(i)];
    G.row(i) = basis.V.row(cell);
    f[i] = rows[static_cast<std::size_t>(cell)].f;
    noise[i] = rows[static_cast<std::size_t>(cell)].variance;
  }
  for (Eigen::Index i = 0; i < raw.rows(); ++i) {
    raw.row(i) = basis.V.row(i);
    plain[i] = std::log(rows[static_cast<std::size_t>(i)].f) + 2;
  }
  const Eigen::VectorXd reference =
      map ? reference_map(G, f, noise, basis.mapping.floor, -2, model_sigma, basis.stddev)
          : reference_map(G, f, Eigen::VectorXd::Zero(m), basis.mapping.floor, -2, model_sigma,
                          Eigen::VectorXd::Constant(5, infinity));
  FitOptions options;
  options.estimator = estimator;
  const Coefficients fitted = fit(basis, {&seen, 1}, 1, options);
  const Eigen::VectorXd naive = (raw.transpose() * raw).ldlt().solve(raw.transpose() * plain);
  Eigen::Index worst = 0;
  (fitted.c.col(0) - reference).cwiseAbs().maxCoeff(&worst);
  return judged("fit", name, reference[worst], fitted.c(worst, 0), naive[worst], 1e-9);
}

}  // namespace

std::vector<StabilityCase> fit_cases() {
  std::vector<Row> good, dirty, range, noise, nothing(30, {nan, 1e-6});
  for (int i = 0; i < 30; ++i) {
    const double f = 0.2 + 0.1 * std::sin(i), wide = 1e4 * std::pow(1e-12, i / 29.0);
    good.push_back({f, 1e-6});
    range.push_back({wide, 1e-4 * wide * wide});
    noise.push_back({f, 1e-18 * std::pow(1e24, i / 29.0)});
  }
  dirty = good;
  dirty[3] = {0, 1e-6};
  dirty[4] = {-1, 1e-6};
  dirty[5] = {nan, 1e-6};
  dirty[6] = {denormal, 1e-6};
  dirty[7] = {infinity, 1e-6};
  dirty[8] = {0.2, nan};
  dirty[9] = {0.2, infinity};
  dirty[10] = {0.2, 0};
  dirty[11] = {0.2, denormal};
  dirty[12] = {-denormal, denormal};
  std::vector<StabilityCase> cases;
  for (const Estimator estimator : {Estimator::map, Estimator::pseudo_inverse}) {
    const bool map = estimator == Estimator::map;
    const auto add = [&](const char* of_map, const char* of_pseudo_inverse,
                         const std::vector<Row>& rows) {
      cases.push_back(fit_case(map ? of_map : of_pseudo_inverse, rows, estimator));
    };
    add("MAP of zeros, negatives, NaN, infinities, denormals",
        "pseudo-inverse of zeros, negatives, NaN, denormals", dirty);
    add("MAP of f over a range of 1e12", "pseudo-inverse of f over a range of 1e12", range);
    add("MAP of deviations over a range of 1e12",
        "pseudo-inverse of deviations over a range of 1e12", noise);
    add("MAP of nothing but NaN: the mean material",
        "pseudo-inverse of nothing but NaN: the mean material", nothing);
  }
  return cases;
}

}  // namespace lightrig
