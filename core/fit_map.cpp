#include "core/fit_map.h"

#include <cmath>
#include <limits>
#include <numbers>

#include "core/check.h"
#include "core/map_solver.h"

namespace lightrig {
namespace {

using Kind = BrdfObservation::Kind;

/// One Newton step's weighted least-squares problem, and the objective where it was formed.
struct Quadratic {
  Eigen::VectorXd target;    ///< (rows) working responses
  Eigen::VectorXd variance;  ///< (rows) inverse working weights
  double objective = 0;      ///< −ln posterior, up to a constant
};

/// A weight below this fraction of a full row's carries no information worth a division.
constexpr double least_weight = 1e-12;

Quadratic quadratic_at(const DesignRows& rows, const Eigen::VectorXd& predicted, double sigma,
                       double outlier_sigma) {
  const Eigen::Index m = rows.G.rows();
  Quadratic q{Eigen::VectorXd(m), Eigen::VectorXd(m), 0};
  for (Eigen::Index i = 0; i < m; ++i) {
    const auto at = static_cast<std::size_t>(i);
    const double variance = rows.noise_variance[at] + sigma * sigma;
    const double s = std::sqrt(variance);
    const double t = (predicted[i] - rows.y[at]) / s;
    if (rows.kind[at] == Kind::value) {
      const bool outlier = outlier_sigma > 0 && std::abs(t) > outlier_sigma;
      const double weight = outlier ? outlier_sigma / std::abs(t) : 1;
      q.target[i] = rows.y[at];
      q.variance[i] = variance / weight;
      q.objective += outlier ? outlier_sigma * (std::abs(t) - outlier_sigma / 2) : t * t / 2;
      continue;
    }
    // −ln Φ(±t): slope ∓λ, curvature λ(λ + t); as a square, weight λ(λ + t)/s² about p ± s/(λ + t).
    const double sign = rows.kind[at] == Kind::above ? 1 : -1;
    const LogNormalCdf cdf = log_normal_cdf(sign * t);
    const double weight = cdf.slope * cdf.excess;
    q.objective -= cdf.value;
    const bool silent = weight < least_weight;
    q.target[i] = silent ? predicted[i] : predicted[i] + sign * s / cdf.excess;
    q.variance[i] = variance / std::max(weight, least_weight);
  }
  return q;
}

double prior_term(const Eigen::VectorXd& c, const Eigen::VectorXd& stddev) {
  return c.cwiseQuotient(stddev).squaredNorm() / 2;
}

/// Whether one least-squares problem is the whole story.
bool plainly_gaussian(const DesignRows& rows, double outlier_sigma) {
  if (outlier_sigma > 0) return false;
  for (const Kind kind : rows.kind) {
    if (kind != Kind::value) return false;
  }
  return true;
}

/// Rows whose working weight never changes, and the others.
struct RowParts {
  std::vector<Eigen::Index> settled, changing;
};
RowParts parts_of(const DesignRows& rows, double outlier_sigma) {
  RowParts parts;
  for (std::size_t i = 0; i < rows.kind.size(); ++i) {
    const bool fixed = rows.kind[i] == Kind::value && outlier_sigma <= 0;
    (fixed ? parts.settled : parts.changing).push_back(static_cast<Eigen::Index>(i));
  }
  return parts;
}

}  // namespace

LogNormalCdf log_normal_cdf(double t) {
  constexpr double ln_root_two_pi = 0.91893853320467274178;
  if (t > -5) {
    const double upper = std::erfc(t / std::numbers::sqrt2) / 2;  // Φ(−t)
    const double cdf = std::erfc(-t / std::numbers::sqrt2) / 2;
    const double slope = std::exp(-t * t / 2 - ln_root_two_pi) / cdf;
    return {t > 0 ? std::log1p(-upper) : std::log(cdf), slope, slope + t};
  }
  // Laplace's continued fraction of Mills' ratio, x = −t: λ = x + 1/(x + 2/(x + 3/(x + …))); the
  // excess is the fraction after the first x, so nothing cancels.
  const double x = -t;
  double tail = x;
  for (int i = 80; i >= 2; --i) tail = x + i / tail;
  const double excess = 1 / tail;
  const double slope = x + excess;
  return {-t * t / 2 - ln_root_two_pi - std::log(slope), slope, excess};
}

Posterior fit_map(const DesignRows& rows, const Eigen::VectorXd& stddev, double sigma,
                  double outlier_sigma) {
  CHECK(sigma > 0);
  constexpr int most_iterations = 100;
  const bool single = plainly_gaussian(rows, outlier_sigma);
  Posterior out;
  out.c = Eigen::VectorXd::Zero(stddev.size());
  const Eigen::VectorXd predicted = Eigen::VectorXd::Zero(rows.G.rows());
  Quadratic q = quadratic_at(rows, predicted, sigma, outlier_sigma);
  double objective = q.objective;
  // Value rows keep their weight: they are summed up once, not in every step.
  const RowParts parts = parts_of(rows, outlier_sigma);
  const MapSolver settled(rows.G(parts.settled, Eigen::all), q.variance(parts.settled), stddev);
  const Eigen::MatrixXd changing_G = rows.G(parts.changing, Eigen::all);
  for (out.iterations = 1;; ++out.iterations) {
    const MapSolver solver(settled, changing_G, q.variance(parts.changing));
    const Eigen::VectorXd goal =
        solver.solve_with(settled, q.target(parts.settled), q.target(parts.changing));
    const Eigen::VectorXd step = goal - out.c;
    const double before = objective;
    // Halve until the objective does not rise; a convex problem needs few halvings.
    double length = 1;
    for (int halving = 0; halving < 30; ++halving, length /= 2) {
      const Eigen::VectorXd c = out.c + length * step;
      const Eigen::VectorXd p = rows.G * c;
      Quadratic next = quadratic_at(rows, p, sigma, outlier_sigma);
      const double value = next.objective + prior_term(c, stddev);
      if (!single && !(value <= before + 1e-12 * std::abs(before))) continue;
      out.c = c;
      q = std::move(next);
      objective = value;
      break;
    }
    const double moved = step.cwiseQuotient(stddev).norm();
    const bool done = moved <= 1e-9 * (1 + out.c.cwiseQuotient(stddev).norm());
    if (single || done || out.iterations == most_iterations) {
      // At the minimum the last problem's curvature is the posterior's.
      out.covariance = solver.covariance();
      break;
    }
  }
  for (Eigen::Index i = 0; i < rows.G.rows(); ++i) {
    const auto at = static_cast<std::size_t>(i);
    const bool value = rows.kind[at] == Kind::value;
    out.weight.push_back(value ? (rows.noise_variance[at] + sigma * sigma) / q.variance[i] : 1.0);
  }
  return out;
}

}  // namespace lightrig
