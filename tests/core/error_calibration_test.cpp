#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>

#include "core/brdf_error.h"
#include "core/censored_rows.h"
#include "core/fit.h"
#include "core/fit_map.h"
#include "tests/core/synthetic_materials.h"

namespace lightrig {
namespace {

using Kind = BrdfObservation::Kind;

TEST(FitRows, FindsWhatTheFitInCoefficientsFindsWithEveryRowAsOftenAsItCounts) {
  std::mt19937_64 random(11);
  std::normal_distribution<double> normal;
  const Eigen::Index m = 14, k = 25;
  const double sigma = 0.15;
  const Eigen::MatrixXd G = Eigen::MatrixXd::NullaryExpr(m, k, [&] { return normal(random); });
  const Eigen::VectorXd stddev =
      Eigen::VectorXd::NullaryExpr(k, [](Eigen::Index i) { return 2 * std::pow(0.8, double(i)); });
  for (const int times : {1, 3}) {
    Eigen::VectorXd y(m);
    std::vector<Kind> kind;
    DesignRows rows;
    rows.G.resize(m * times, k);
    for (Eigen::Index i = 0; i < m; ++i) {
      y[i] = 2 * normal(random);
      kind.push_back(i % 3 == 0 ? Kind::value : i % 3 == 1 ? Kind::above : Kind::below);
      for (int j = 0; j < times; ++j) {
        rows.G.row(i * times + j) = G.row(i);
        rows.y.push_back(y[i]);
        rows.noise_variance.push_back(0);
        rows.kind.push_back(kind.back());
      }
    }
    const Posterior p = fit_map(rows, stddev, sigma, 0);
    const RowProblem problem = row_problem(G * stddev.asDiagonal(), stddev);
    const RowPosterior q = fit_rows(problem, y, kind, sigma, times);
    EXPECT_TRUE(q.converged);
    const Eigen::VectorXd c = stddev.cwiseAbs2().asDiagonal() * (G.transpose() * q.a);
    EXPECT_LT((c - p.c).cwiseQuotient(stddev).norm(), 1e-5);
    EXPECT_NEAR(q.told, stddev.squaredNorm() - p.covariance.trace(), 1e-5 * q.told);
    const double freedom = static_cast<double>(k) -
                           p.covariance.diagonal().dot(stddev.cwiseAbs2().cwiseInverse().eval());
    EXPECT_NEAR(q.freedom, freedom, 1e-5 * freedom);
  }
}

const BivariateGrid grid{20, 15};

/// Every cell of three columns of θd, clipped outside a range about the median.
BrdfObservations observe(const BrdfTable& truth, double range) {
  std::vector<double> values;
  for (int cell = 0; cell < grid.cells(); ++cell) {
    if (grid.column_d(cell) % 5 == 1) values.push_back(truth.f.row(cell).mean());
  }
  std::sort(values.begin(), values.end());
  const double low = values[values.size() / 2] / std::sqrt(range);
  const double high = values[values.size() / 2] * std::sqrt(range);
  BrdfObservations out;
  for (int channel = 0; channel < truth.f.cols(); ++channel) {
    for (int cell = 0; cell < grid.cells(); ++cell) {
      if (grid.column_d(cell) % 5 != 1) continue;
      BrdfObservation o;
      o.cell = cell;
      o.channel = static_cast<std::int8_t>(channel);
      o.count = 10;
      const double f = truth.f(cell, channel);
      o.kind = f < low ? Kind::below : f > high ? Kind::above : Kind::value;
      o.f = std::clamp(f, low, high);
      out.rows.push_back(o);
    }
  }
  return out;
}

struct Outcome {
  int inside = 0;
  double relative_width = 0, censored = 0;
};

/// Unseen materials of the training set's own kind through one clipped fit each.
Outcome outcome(const BrdfBasis& basis, const std::vector<Material>& unseen, double range) {
  Outcome out;
  for (const Material& material : unseen) {
    const std::vector<BrdfObservations> lights = {observe(material.table, range)};
    const Coefficients c = fit(basis, lights, 3, {});
    const Reconstruction r = reconstruct(basis, c);
    const double error = brdf_error(r.brdf, material.table, 1e-4).percent_log;
    out.inside += error >= r.predicted_low_percent && error <= r.predicted_high_percent;
    out.relative_width = r.predicted_high_percent / r.predicted_low_percent;
    out.censored += posterior_size(basis, c).censored / static_cast<double>(unseen.size());
  }
  return out;
}

TEST(ErrorInterval, HoldsNineInTenTruthsClippedOrNotAndWidensWithClipping) {
  BasisOptions options;
  options.floor = 1e-6;
  const BrdfBasis basis = *make_basis(synthetic_materials(60, grid, 21), options);
  EXPECT_GT(basis.calibration.censored_share, 0);
  const std::vector<Material> unseen = synthetic_materials(60, grid, 77);
  // Of sixty draws of 90 % the count scatters by 2.3: three deviations either way.
  for (const double range : {1e12, 60.0}) {
    const Outcome o = outcome(basis, unseen, range);
    EXPECT_GE(o.inside, 47) << range;
    EXPECT_LE(o.inside, 59) << range;
    if (range < 1e12) {
      EXPECT_GT(o.censored, 0.02);
    } else {
      EXPECT_EQ(o.censored, 0);
    }
  }
}

TEST(ErrorInterval, IsNoNarrowerForRowsThatAreBounds) {
  BrdfBasis basis;
  basis.calibration.exact = {-0.5, 0.4};
  basis.calibration.censored = {-0.7, 0.9};
  basis.calibration.censored_share = 0.2;
  PosteriorSize size;
  EXPECT_DOUBLE_EQ(error_interval(basis, size).low, std::exp(-0.5));
  EXPECT_DOUBLE_EQ(error_interval(basis, size).high, std::exp(0.4));
  size.censored = 0.2;
  EXPECT_DOUBLE_EQ(error_interval(basis, size).high, std::exp(0.9));
  size.censored = 0.1;
  EXPECT_NEAR(std::log(error_interval(basis, size).high), 0.65, 1e-12);
  // Beyond twice what was tried nothing is known, and the band stays.
  size.censored = 1;
  EXPECT_NEAR(std::log(error_interval(basis, size).high), 1.4, 1e-12);
}

}  // namespace
}  // namespace lightrig
