#include "core/adaptive_fit.h"

#include <algorithm>
#include <cmath>
#include <vector>

namespace lightrig {
namespace {

constexpr int most_rounds = 12;
constexpr double settled = 0.02;

double square(double x) { return x * x; }

// Residual and noise of one value row, mapped units, squared.
struct Row {
  double residual2 = 0, noise2 = 0;
};

std::vector<Row> rows_of(const BrdfBasis& basis, std::span<const BrdfObservations> lights,
                         int channels, const Coefficients& fitted) {
  std::vector<Row> rows;
  for (const BrdfObservations& light : lights) {
    for (const BrdfObservation& o : light.rows) {
      if (o.kind != BrdfObservation::Kind::value || o.channel >= channels ||
          basis.valid[static_cast<std::size_t>(o.cell)] == 0 || !std::isfinite(o.f) ||
          !std::isfinite(o.variance)) {
        continue;
      }
      const Eigen::Index row = basis.row(o.cell, o.channel);
      const Eigen::Index column = std::min<Eigen::Index>(o.channel, fitted.c.cols() - 1);
      const double predicted = basis.mean[row] + basis.V.row(row).dot(fitted.c.col(column));
      const double slope = map_slope(basis.mapping, o.cell, std::max(o.f, basis.mapping.floor));
      rows.push_back(
          {square(map_value(basis.mapping, o.cell, o.f) - predicted), square(slope) * o.variance});
    }
  }
  return rows;
}

// Number of coefficients that the data rather than the prior determine.
double determined(const BrdfBasis& basis, const Coefficients& fitted) {
  double count = 0;
  for (const Eigen::MatrixXd& covariance : fitted.covariance) {
    for (Eigen::Index j = 0; j < basis.components(); ++j) {
      if (!(basis.stddev[j] > 0)) continue;
      count += std::clamp(1 - covariance(j, j) / square(basis.stddev[j]), 0.0, 1.0);
    }
  }
  return count;
}

double judged_sigma(const std::vector<Row>& rows, double coefficients, double sigma) {
  const auto n = static_cast<double>(rows.size());
  // With hardly more rows than coefficients the residual says nothing: keep half of the rows.
  const double correction = n / std::max(n - coefficients, 0.5 * n);
  double sum = 0, weights = 0;
  for (const Row& row : rows) {
    const double weight = 1 / square(square(sigma) + row.noise2);
    sum += weight * (row.residual2 * correction - row.noise2);
    weights += weight;
  }
  return weights > 0 ? std::sqrt(std::max(0.0, sum / weights)) : 0;
}

}  // namespace

AdaptiveFit fit_adaptive(const BrdfBasis& basis, std::span<const BrdfObservations> lights,
                         int channels, const FitOptions& options) {
  FitOptions adapted = options;
  AdaptiveFit out;
  out.model_sigma = options.model_sigma > 0 ? options.model_sigma : basis.model_sigma;
  adapted.model_sigma = out.model_sigma;
  out.coefficients = fit(basis, lights, channels, adapted);
  if (options.estimator != Estimator::map) return out;
  for (int round = 0; round < most_rounds; ++round) {
    const double judged = judged_sigma(rows_of(basis, lights, channels, out.coefficients),
                                       determined(basis, out.coefficients), out.model_sigma);
    if (!(judged > (1 + settled) * out.model_sigma)) break;
    out.model_sigma = adapted.model_sigma = judged;
    out.raised = true;
    out.coefficients = fit(basis, lights, channels, adapted);
  }
  return out;
}

}  // namespace lightrig
