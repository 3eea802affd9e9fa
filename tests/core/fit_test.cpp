#include "core/fit.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <Eigen/Eigenvalues>
#include <boost/math/special_functions/erf.hpp>
#include <boost/multiprecision/cpp_dec_float.hpp>
#include <random>

#include "core/brdf_error.h"
#include "core/fit_map.h"
#include "synthetic_materials.h"

namespace lightrig {
namespace {

using Kind = BrdfObservation::Kind;
using Decimal = boost::multiprecision::number<boost::multiprecision::cpp_dec_float<80>,
                                              boost::multiprecision::et_off>;

// --- a second implementation of MAP, in 80 decimal digits ---------------------------------------

std::vector<Decimal> solve_in_decimals(std::vector<std::vector<Decimal>> A,
                                       std::vector<Decimal> b) {
  const std::size_t n = b.size();
  for (std::size_t i = 0; i < n; ++i) {
    std::size_t pivot = i;
    for (std::size_t r = i + 1; r < n; ++r) {
      if (abs(A[r][i]) > abs(A[pivot][i])) pivot = r;
    }
    std::swap(A[i], A[pivot]);
    std::swap(b[i], b[pivot]);
    for (std::size_t r = i + 1; r < n; ++r) {
      const Decimal factor = A[r][i] / A[i][i];
      for (std::size_t c = i; c < n; ++c) A[r][c] -= factor * A[i][c];
      b[r] -= factor * b[i];
    }
  }
  for (std::size_t i = n; i-- > 0;) {
    for (std::size_t c = i + 1; c < n; ++c) b[i] -= A[i][c] * b[c];
    b[i] /= A[i][i];
  }
  return b;
}

/// (GᵀWG + S⁻²)⁻¹ GᵀWy by Gaussian elimination.
Eigen::VectorXd map_in_decimals(const DesignRows& rows, const Eigen::VectorXd& stddev,
                                double sigma) {
  const auto k = static_cast<std::size_t>(stddev.size());
  std::vector<std::vector<Decimal>> A(k, std::vector<Decimal>(k, 0));
  std::vector<Decimal> b(k, 0);
  for (std::size_t i = 0; i < k; ++i) {
    const Decimal s = stddev[static_cast<Eigen::Index>(i)];
    A[i][i] = 1 / (s * s);
  }
  for (std::size_t r = 0; r < rows.y.size(); ++r) {
    const Decimal w = 1 / (Decimal(rows.noise_variance[r]) + Decimal(sigma) * Decimal(sigma));
    const auto row = static_cast<Eigen::Index>(r);
    for (std::size_t i = 0; i < k; ++i) {
      const Decimal gi = rows.G(row, static_cast<Eigen::Index>(i));
      b[i] += w * gi * Decimal(rows.y[r]);
      for (std::size_t j = 0; j < k; ++j) {
        A[i][j] += w * gi * Decimal(rows.G(row, static_cast<Eigen::Index>(j)));
      }
    }
  }
  const std::vector<Decimal> c = solve_in_decimals(A, b);
  Eigen::VectorXd out(stddev.size());
  for (std::size_t i = 0; i < k; ++i) out[static_cast<Eigen::Index>(i)] = static_cast<double>(c[i]);
  return out;
}

DesignRows random_rows(Eigen::Index m, Eigen::Index k, std::uint64_t seed) {
  std::mt19937_64 random(seed);
  std::normal_distribution<double> normal;
  DesignRows rows;
  rows.G = Eigen::MatrixXd::NullaryExpr(m, k, [&] { return normal(random); });
  for (Eigen::Index i = 0; i < m; ++i) {
    rows.y.push_back(normal(random));
    rows.noise_variance.push_back(std::exp(2 * normal(random)));
    rows.kind.push_back(Kind::value);
  }
  return rows;
}

struct Stiffness {
  const char* name;
  Eigen::Index rows;
  double prior_ratio;  // of the first component's deviation to the last's
  double sigma;
};
class FitMap : public testing::TestWithParam<Stiffness> {};

TEST_P(FitMap, AgreesWithEightyDigits) {
  const Stiffness p = GetParam();
  const Eigen::Index k = 12;
  DesignRows rows = random_rows(p.rows, k, 3);
  Eigen::VectorXd stddev(k);
  for (Eigen::Index i = 0; i < k; ++i) {
    stddev[i] = 10 * std::pow(p.prior_ratio, -double(i) / double(k - 1));
  }
  const Posterior posterior = fit_map(rows, stddev, p.sigma, 0);
  const Eigen::VectorXd reference = map_in_decimals(rows, stddev, p.sigma);
  const Eigen::VectorXd scaled = (posterior.c - reference).cwiseQuotient(stddev);
  EXPECT_LT(scaled.norm(), 1e-9 * (1 + reference.cwiseQuotient(stddev).norm()));
}
INSTANTIATE_TEST_SUITE_P(Cases, FitMap,
                         testing::Values(Stiffness{"ManyRows", 60, 1e2, 0.1},
                                         Stiffness{"FewerRowsThanComponents", 4, 1e2, 0.1},
                                         Stiffness{"StiffPrior", 60, 1e8, 0.1},
                                         Stiffness{"TinySigma", 30, 1e2, 1e-5},
                                         Stiffness{"HugeSigma", 30, 1e2, 1e6}),
                         [](const auto& level) { return std::string(level.param.name); });

TEST(FitMapCensored, FindsTheScalarMaximumThatEightyDigitsFind) {
  // One component, one row each of value, above, below; the derivative of the log posterior is
  // bisected in decimals.
  using boost::multiprecision::exp;
  using boost::multiprecision::sqrt;
  for (const double bound : {-40.0, -3.0, 0.5, 4.0, 60.0}) {
    DesignRows rows;
    rows.G = Eigen::MatrixXd::Ones(2, 1);
    rows.y = {0.2, bound};
    rows.noise_variance = {0.03, 0.01};
    rows.kind = {Kind::value, Kind::above};
    const double sigma = 0.1, prior = 2;
    const auto slope = [&](const Decimal& c) {
      const Decimal v0 = Decimal(0.03) + Decimal(0.1) * Decimal(0.1);
      const Decimal s1 = sqrt(Decimal(0.01) + Decimal(0.1) * Decimal(0.1));
      const Decimal t = (c - Decimal(bound)) / s1;
      const Decimal cdf = boost::math::erfc(Decimal(-t / sqrt(Decimal(2)))) / 2;
      const Decimal density = exp(-t * t / 2) / sqrt(2 * boost::math::constants::pi<Decimal>());
      return Decimal((Decimal(0.2) - c) / v0 + density / cdf / s1 - c / (prior * prior));
    };
    Decimal low = -100, high = 100;
    for (int i = 0; i < 200; ++i) {
      const Decimal middle = (low + high) / 2;
      (slope(middle) > 0 ? low : high) = middle;
    }
    const Posterior p = fit_map(rows, Eigen::VectorXd::Constant(1, prior), sigma, 0);
    EXPECT_NEAR(p.c[0], static_cast<double>(low), 1e-8 * (1 + std::abs(static_cast<double>(low))))
        << "bound " << bound;
    EXPECT_LT(p.iterations, 60);
  }
}

TEST(LogNormalCdf, IsAccurateFarIntoBothTails) {
  using boost::multiprecision::log;
  for (const double t :
       {-1e4, -300.0, -40.0, -8.0, -5.001, -4.999, -1.0, 0.0, 1e-8, 3.0, 8.0, 30.0}) {
    const Decimal x = t;
    const LogNormalCdf value = log_normal_cdf(t);
    // Mills' ratio by its own series in decimals where erfc would underflow even there.
    if (t < -1000) {
      EXPECT_NEAR(value.excess * -t, 1, 1e-6);
      continue;
    }
    const Decimal cdf = boost::math::erfc(Decimal(-x / sqrt(Decimal(2)))) / 2;
    const Decimal slope = exp(-x * x / 2) / sqrt(2 * boost::math::constants::pi<Decimal>()) / cdf;
    // Past eighty digits of 1 − Φ, ln Φ(t) is −Φ(−t) itself.
    const Decimal upper = boost::math::erfc(Decimal(x / sqrt(Decimal(2)))) / 2;
    const auto ln = static_cast<double>(t > 10 ? Decimal(-upper) : Decimal(log(cdf)));
    EXPECT_NEAR(value.value, ln, 1e-12 * std::abs(ln)) << t;
    EXPECT_NEAR(value.slope / static_cast<double>(slope), 1, 1e-12) << t;
    EXPECT_NEAR(value.excess / static_cast<double>(Decimal(slope + x)), 1, 1e-10) << t;
  }
}

// --- whole fits ----------------------------------------------------------------------------------

const BivariateGrid grid{20, 15};

BrdfBasis training_basis(ChannelLayout layout = ChannelLayout::columns, int components = 0) {
  BasisOptions options;
  options.layout = layout;
  options.components = components;
  return *make_basis(synthetic_materials(40, grid, 21), options);
}

/// Exact values of a table in some columns of θd.
BrdfObservations observe(const BrdfTable& truth, const std::vector<int>& columns,
                         double relative_noise = 0) {
  BrdfObservations out;
  for (int channel = 0; channel < truth.f.cols(); ++channel) {
    for (int cell = 0; cell < grid.cells(); ++cell) {
      if (std::count(columns.begin(), columns.end(), grid.column_d(cell)) == 0) continue;
      BrdfObservation o;
      o.cell = cell;
      o.channel = static_cast<std::int8_t>(channel);
      o.count = 10;
      o.f = truth.f(cell, channel);
      o.variance = std::pow(relative_noise * o.f, 2);
      out.rows.push_back(o);
    }
  }
  return out;
}

TEST(Fit, BringsBackAnUnseenMaterialAndMapBeatsThePseudoInverse) {
  const BrdfBasis basis = training_basis();
  const BrdfTable truth = synthetic_materials(3, grid, 99)[2].table;
  const std::vector<BrdfObservations> lights = {observe(truth, {1}), observe(truth, {7}),
                                                observe(truth, {12})};
  const Coefficients map = fit(basis, lights, 3, {});
  FitOptions paper;
  paper.estimator = Estimator::pseudo_inverse;
  const Coefficients pinv = fit(truncated(basis, 20), lights, 3, paper);
  const double map_error = brdf_error(evaluate(basis, map.c), truth, 1e-4).percent_log;
  const double pinv_error =
      brdf_error(evaluate(truncated(basis, 20), pinv.c), truth, 1e-4).percent_log;
  const double mean_error =
      brdf_error(evaluate(basis, Eigen::MatrixXd::Zero(basis.components(), 3)), truth, 1e-4)
          .percent_log;
  EXPECT_LT(map_error, 5);
  EXPECT_LT(map_error, pinv_error);
  EXPECT_GT(mean_error, 5 * map_error);
  EXPECT_EQ(map.rows_value, 3 * 3 * 20);
}

TEST(Fit, PseudoInverseMeetsTheNormalEquationsChannelByChannelInBothLayouts) {
  for (const ChannelLayout layout : {ChannelLayout::columns, ChannelLayout::stacked}) {
    const BrdfBasis basis = training_basis(layout, 8);
    const BrdfTable truth = synthetic_materials(1, grid, 98)[0].table;
    const std::vector<BrdfObservations> lights = {observe(truth, {2, 5, 9})};
    FitOptions paper;
    paper.estimator = Estimator::pseudo_inverse;
    const Coefficients c = fit(basis, lights, 3, paper);
    ASSERT_EQ(c.c.cols(), 3);
    for (int channel = 0; channel < 3; ++channel) {
      Eigen::VectorXd gradient = Eigen::VectorXd::Zero(8);
      for (const BrdfObservation& o : lights[0].rows) {
        if (o.channel != channel) continue;
        const Eigen::Index row = basis.row(o.cell, channel);
        const Eigen::VectorXd g = basis.V.row(row);
        gradient += g * (std::log(o.f) - basis.mean[row] - g.dot(c.c.col(channel)));
      }
      EXPECT_LT(gradient.norm(), 1e-10);
    }
    EXPECT_EQ(c.rank, 8);
  }
}

TEST(Fit, StackedMapSolvesAllChannelsTogether) {
  const BrdfBasis basis = training_basis(ChannelLayout::stacked);
  const BrdfTable truth = synthetic_materials(40, grid, 21)[5].table;
  const std::vector<BrdfObservations> lights = {observe(truth, {1, 6, 11})};
  const Coefficients c = fit(basis, lights, 3, {});
  EXPECT_EQ(c.c.cols(), 1);
  EXPECT_EQ(c.covariance.size(), 1U);
  EXPECT_LT(brdf_error(evaluate(basis, c.c), truth, 1e-4).percent_log, 3);
}

TEST(Fit, WithoutAnyRowIsThePriorAndSaysSo) {
  const BrdfBasis basis = training_basis();
  for (const Estimator estimator : {Estimator::map, Estimator::pseudo_inverse}) {
    FitOptions options;
    options.estimator = estimator;
    const Coefficients c = fit(basis, {}, 3, options);
    EXPECT_EQ(c.c.norm(), 0);
    EXPECT_EQ(c.rank, 0);
    const Eigen::MatrixXd prior = basis.stddev.cwiseAbs2().asDiagonal();
    EXPECT_LT((c.covariance[1] - prior).norm(), 1e-9 * prior.norm());
  }
}

TEST(Fit, OfASingleBinStaysWideAndFarFromNonsense) {
  const BrdfBasis basis = training_basis();
  const BrdfTable truth = synthetic_materials(1, grid, 97)[0].table;
  BrdfObservations one = observe(truth, {4});
  one.rows.resize(1);
  const Reconstruction r = reconstruct(basis, fit(basis, std::vector{one}, 3, {}));
  const Reconstruction none = reconstruct(basis, fit(basis, {}, 3, {}));
  const double error = brdf_error(r.brdf, truth, 1e-4).percent_log;
  EXPECT_LT(r.predicted_error_percent, none.predicted_error_percent);
  EXPECT_GT(r.predicted_error_percent, 10);
  EXPECT_LT(error, r.predicted_high_percent * 1.5);
  EXPECT_TRUE(r.brdf.f.isFinite().all());
}

TEST(Fit, RepeatedLightsAddNoFalseConfidenceInTheModel) {
  // The same exact cells seen twice are one row: model error does not average out.
  const BrdfBasis basis = training_basis();
  const BrdfTable truth = synthetic_materials(1, grid, 96)[0].table;
  const BrdfObservations light = observe(truth, {3, 8});
  const Coefficients once = fit(basis, std::vector{light}, 3, {});
  const Coefficients thrice = fit(basis, std::vector{light, light, light}, 3, {});
  EXPECT_LT((once.c - thrice.c).norm(), 1e-9 * once.c.norm());
  EXPECT_NEAR(once.covariance[0].trace() / thrice.covariance[0].trace(), 1, 1e-9);
}

TEST(Fit, UsesClippedRowsBetterAsBoundsThanNotAtAll) {
  // Everything brighter than a level is known only to be above it.
  const BrdfBasis basis = training_basis();
  double with = 0, without = 0;
  for (const Material& material : synthetic_materials(12, grid, 95)) {
    BrdfObservations light = observe(material.table, {1, 7, 12});
    const double level = 0.5 * material.table.f.maxCoeff();
    for (BrdfObservation& o : light.rows) {
      if (o.f < level) continue;
      o.kind = Kind::above;
      o.f = level;
    }
    FitOptions drop;
    drop.use_censored = false;
    const std::vector<BrdfObservations> lights = {light};
    with +=
        brdf_error(evaluate(basis, fit(basis, lights, 3, {}).c), material.table, 1e-4).percent_log;
    without += brdf_error(evaluate(basis, fit(basis, lights, 3, drop).c), material.table, 1e-4)
                   .percent_log;
  }
  EXPECT_LT(with, without);
}

TEST(Fit, HubersRuleKeepsAFewWildRowsFromRuiningTheRest) {
  const BrdfBasis basis = training_basis();
  const BrdfTable truth = synthetic_materials(1, grid, 94)[0].table;
  BrdfObservations light = observe(truth, {1, 7, 12});
  for (std::size_t i = 0; i < light.rows.size(); i += 17) light.rows[i].f *= 20;
  const std::vector<BrdfObservations> lights = {light};
  FitOptions huber;
  huber.outlier_sigma = 2;
  const double plain =
      brdf_error(evaluate(basis, fit(basis, lights, 3, {}).c), truth, 1e-4).percent_log;
  const double robust =
      brdf_error(evaluate(basis, fit(basis, lights, 3, huber).c), truth, 1e-4).percent_log;
  EXPECT_LT(robust, 0.5 * plain);
}

TEST(PredictedError, IsTheSameByTheTraceAndByEveryCell) {
  const BrdfBasis basis = training_basis();
  const BrdfTable truth = synthetic_materials(1, grid, 93)[0].table;
  const Coefficients c = fit(basis, std::vector{observe(truth, {2, 9})}, 3, {});
  EXPECT_NEAR(predicted_error_percent(basis, c.covariance, c.c),
              reconstruct(basis, c).predicted_error_percent, 1e-6);
}

TEST(PredictedError, FallsWithEveryLight) {
  const BrdfBasis basis = training_basis();
  const BrdfTable truth = synthetic_materials(1, grid, 92)[0].table;
  double before = 1e9;
  std::vector<BrdfObservations> lights;
  for (const int column : {0, 3, 6, 9, 12}) {
    lights.push_back(observe(truth, {column}, 0.01));
    const double now = reconstruct(basis, fit(basis, lights, 3, {})).predicted_error_percent;
    EXPECT_LT(now, before);
    before = now;
  }
}

TEST(PredictedError, IsTheTrueErrorOfMostUnseenMaterials) {
  // Median and coverage, not the mean: a material outside the training range is clipped to it, and
  // no statistics of the training set foresee how far outside a material may lie.
  const BrdfBasis basis = training_basis();
  std::vector<double> ratio;
  for (const Material& material : synthetic_materials(40, grid, 91)) {
    const Reconstruction r =
        reconstruct(basis, fit(basis, std::vector{observe(material.table, {2, 9})}, 3, {}));
    ratio.push_back(brdf_error(r.brdf, material.table, 1e-4).percent_log /
                    r.predicted_error_percent);
  }
  std::sort(ratio.begin(), ratio.end());
  EXPECT_NEAR(ratio[20], 1, 0.15);
  EXPECT_GT(ratio[4], 0.75);
  EXPECT_LT(ratio[34], 1.4);
}

// The deviation of ln f that one deviation of the only coefficient makes, by evaluating the table
// a little to either side.
TEST(Reconstruct, SaysTheDeviationOfLnFWhateverTheMapping) {
  for (const Mapping kind : {Mapping::ln_floor, Mapping::ln_offset, Mapping::log_relative}) {
    BrdfBasis basis;
    basis.grid = {4, 1};
    basis.mapping.kind = kind;
    basis.mapping.floor = 0.01;
    basis.mapping.weight = Eigen::Vector4d(1, 0.8, 0.5, 0.2);
    basis.mapping.reference = Eigen::Vector4d(0.3, 0.1, 0.05, 0.02);
    basis.valid.assign(4, 1);
    basis.mean.resize(4);
    const Eigen::Vector4d f(0.5, 0.1, 0.03, 0.011);
    for (int cell = 0; cell < 4; ++cell) {
      basis.mean[cell] = map_value(basis.mapping, cell, f[cell]);
    }
    basis.V = Eigen::Vector4d(0.5, -0.5, 0.1, 0.7);
    basis.stddev = basis.training_stddev = Eigen::VectorXd::Constant(1, 2);
    basis.y_min = Eigen::VectorXd::Constant(4, -50);
    basis.y_max = Eigen::VectorXd::Constant(4, 50);
    basis.unsaid_sigma = 0;
    const auto with = [&](double c) {
      Coefficients coefficients;
      coefficients.c = Eigen::MatrixXd::Constant(1, 1, c);
      coefficients.covariance = {Eigen::MatrixXd::Constant(1, 1, 0.09)};
      return reconstruct(basis, coefficients);
    };
    const Reconstruction at = with(0), above = with(1e-5), below = with(-1e-5);
    for (int cell = 0; cell < 4; ++cell) {
      const double slope = std::log(above.brdf.f(cell, 0) / below.brdf.f(cell, 0)) / 2e-5;
      EXPECT_NEAR(at.log_stddev(cell, 0), std::abs(slope) * 0.3, 1e-8) << cell;
    }
  }
}

}  // namespace
}  // namespace lightrig
