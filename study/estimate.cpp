#include "study/estimate.h"

#include <Eigen/QR>
#include <algorithm>
#include <cmath>
#include <limits>
#include <random>

#include "core/azimuth_model.h"
#include "core/fit.h"
#include "core/map_solver.h"

namespace lightrig {
namespace {

constexpr double nan = std::numeric_limits<double>::quiet_NaN();

/// Mapped values of every test material and channel at some cells: (cells × 3·materials), column
/// material · channels + channel.
Eigen::MatrixXd observed(const LogMapping& mapping, std::span<const Material> test,
                         const std::vector<std::int32_t>& cells) {
  const Eigen::Index channels = test.front().table.f.cols();
  Eigen::MatrixXd y(static_cast<Eigen::Index>(cells.size()),
                    channels * static_cast<Eigen::Index>(test.size()));
  for (std::size_t m = 0; m < test.size(); ++m) {
    for (Eigen::Index channel = 0; channel < channels; ++channel) {
      for (std::size_t i = 0; i < cells.size(); ++i) {
        y(static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(m) * channels + channel) =
            map_value(mapping, cells[i], test[m].table.f(cells[i], channel));
      }
    }
  }
  return y;
}

BrdfTable columns_of(const BrdfTable& all, Eigen::Index first, Eigen::Index count) {
  return {all.grid, all.f.middleCols(first, count)};
}

double ln2_of(const BrdfTable& table, double floor) {
  double sum = 0;
  for (Eigen::Index i = 0; i < table.f.size(); ++i) {
    const double f = table.f.data()[i];
    if (std::isfinite(f)) sum += std::pow(std::log(std::max(f, floor)), 2);
  }
  return sum;
}

MaterialResult with_prediction(const BrdfBasis& basis, BrdfTable estimate, const BrdfTable& truth,
                               const PosteriorSize& size, double floor) {
  MaterialResult out;
  out.error = brdf_error(estimate, truth, floor);
  // From sizes alone a posterior tells the error of ln f only where it is one of ln f.
  out.predicted =
      basis.mapping.kind == Mapping::ln_floor
          ? predicted_error_percent(basis, size, ln2_of(estimate, floor), estimate.f.cols())
          : nan;
  const ErrorInterval interval = error_interval(basis, size);
  out.low = out.predicted * interval.low;
  out.high = out.predicted * interval.high;
  out.estimate = std::move(estimate);
  return out;
}

/// What a bracket holds [1/sr].
struct BracketRange {
  double low = 0, high = std::numeric_limits<double>::infinity();
};

/// A bracket of this range about the median of the values or, metered, where it holds most of them,
/// what it spans beyond these shared between both ends.
BracketRange bracket_range(std::vector<double> values, double range, bool metered) {
  std::sort(values.begin(), values.end());
  if (!metered) {
    const double middle = values[values.size() / 2];
    return {middle / std::sqrt(range), middle * std::sqrt(range)};
  }
  std::size_t first = 0, last = 0;  // of the best window
  for (std::size_t i = 0, j = 0; i < values.size(); ++i) {
    while (j + 1 < values.size() && values[j + 1] <= range * values[i]) ++j;
    if (j - i >= last - first) {
      first = i;
      last = j;
    }
  }
  const double low = std::sqrt(values[first] * values[last] / range);
  return {low, low * range};
}

/// One clipped, noisy measurement of every channel and cell.
BrdfObservations measure(const BrdfTable& truth, const std::vector<std::int32_t>& cells,
                         const MeasuredRows& options, bool keep_clipped, std::mt19937_64& random) {
  std::vector<double> values;
  for (const std::int32_t cell : cells) {
    for (Eigen::Index c = 0; c < truth.f.cols(); ++c) values.push_back(truth.f(cell, c));
  }
  // Darker than the logarithm's floor is as dark as the floor.
  for (double& value : values) value = std::max(value, options.floor);
  BracketRange bracket;
  // 12 bits, usable from 8 to 4,000 counts: a range of 500 per exposure, a factor 8 between two.
  if (options.exposures > 0) {
    bracket = bracket_range(std::move(values), 500.0 * std::pow(8.0, options.exposures - 1),
                            options.metered);
  }
  const auto [low, high] = bracket;
  BrdfObservations out;
  std::normal_distribution<double> normal;
  for (int channel = 0; channel < truth.f.cols(); ++channel) {
    for (const std::int32_t cell : cells) {
      BrdfObservation o;
      o.cell = cell;
      o.channel = static_cast<std::int8_t>(channel);
      o.count = 1;
      const double f = truth.f(cell, channel) * (1 + options.noise * normal(random));
      const bool clipped = f < low || f > high;
      o.f = std::clamp(f, low, high);
      o.variance = std::pow(options.noise * o.f, 2);
      if (clipped && !keep_clipped) {
        o.kind = f > high ? BrdfObservation::Kind::above : BrdfObservation::Kind::below;
      }
      out.rows.push_back(o);
    }
  }
  return out;
}

}  // namespace

std::vector<MaterialResult> estimate_paper(const BrdfBasis& basis, std::span<const Material> test,
                                           const std::vector<std::int32_t>& cells, double floor) {
  const Eigen::MatrixXd y = observed(basis.mapping, test, cells);
  const Eigen::Index channels = basis.channels;
  const auto materials = static_cast<Eigen::Index>(test.size());
  Eigen::MatrixXd c(basis.components(), y.cols());
  for (int channel = 0; channel < channels; ++channel) {
    Eigen::MatrixXd G(y.rows(), basis.components()), b(y.rows(), materials);
    for (Eigen::Index i = 0; i < y.rows(); ++i) {
      const Eigen::Index row = basis.row(cells[static_cast<std::size_t>(i)], channel);
      G.row(i) = basis.V.row(row);
      for (Eigen::Index m = 0; m < materials; ++m) {
        b(i, m) = y(i, m * channels + channel) - basis.mean[row];
      }
    }
    Eigen::CompleteOrthogonalDecomposition<Eigen::MatrixXd> qr;
    qr.setThreshold(static_cast<double>(std::max(G.rows(), G.cols())) *
                    std::numeric_limits<double>::epsilon());
    qr.compute(G);
    const Eigen::MatrixXd solved = qr.solve(b);
    for (Eigen::Index m = 0; m < materials; ++m) c.col(m * channels + channel) = solved.col(m);
  }
  std::vector<MaterialResult> out;
  for (Eigen::Index m = 0; m < materials; ++m) {
    BrdfTable estimate = evaluate(basis, c.middleCols(m * channels, channels));
    const BrdfTable& truth = test[static_cast<std::size_t>(m)].table;
    const BrdfError error = brdf_error(estimate, truth, floor);
    out.push_back({error, nan, nan, nan, std::move(estimate)});
  }
  return out;
}

std::vector<MaterialResult> estimate_map(const BrdfBasis& basis, std::span<const Material> test,
                                         const std::vector<std::int32_t>& cells, double floor) {
  const Eigen::Index channels = test.front().table.f.cols();
  Eigen::MatrixXd y = observed(basis.mapping, test, cells);
  Eigen::MatrixXd G(y.rows(), basis.components());
  for (Eigen::Index i = 0; i < y.rows(); ++i) {
    const std::int32_t cell = cells[static_cast<std::size_t>(i)];
    G.row(i) = basis.V.row(cell);
    y.row(i).array() -= basis.mean[cell];
  }
  const Eigen::VectorXd variance =
      Eigen::VectorXd::Constant(G.rows(), basis.model_sigma * basis.model_sigma);
  const MapSolver solver(G, variance, basis.stddev);
  const Eigen::MatrixXd c = solver.solve(y);
  const Eigen::MatrixXd covariance = solver.covariance();
  const PosteriorSize one =
      posterior_size(basis, {&covariance, 1}, Eigen::MatrixXd::Zero(c.rows(), 1));
  const BrdfTable all = evaluate(basis, c);
  std::vector<MaterialResult> out;
  for (std::size_t m = 0; m < test.size(); ++m) {
    const Eigen::Index first = static_cast<Eigen::Index>(m) * channels;
    PosteriorSize size{channels, 0, 0, 0};
    size.trace = one.trace * static_cast<double>(channels);
    size.freedom = one.freedom * static_cast<double>(channels);
    for (Eigen::Index i = 0; i < channels; ++i) {
      size.z2 += c.col(first + i).cwiseQuotient(basis.stddev).squaredNorm();
    }
    out.push_back(
        with_prediction(basis, columns_of(all, first, channels), test[m].table, size, floor));
  }
  return out;
}

std::vector<MaterialResult> estimate_measured(const BrdfBasis& basis,
                                              std::span<const Material> test, bool map,
                                              const std::vector<std::int32_t>& cells,
                                              const MeasuredRows& measured) {
  FitOptions fit_options;
  fit_options.estimator = map ? Estimator::map : Estimator::pseudo_inverse;
  fit_options.find_rank = false;
  std::vector<MaterialResult> out;
  for (std::size_t m = 0; m < test.size(); ++m) {
    std::mt19937_64 random(measured.seed + 7919 * m);
    const BrdfTable& truth = test[m].table;
    const std::vector<BrdfObservations> lights = {measure(truth, cells, measured, !map, random)};
    const Coefficients c = fit(basis, lights, static_cast<int>(truth.f.cols()), fit_options);
    BrdfTable estimate = evaluate(basis, c.c);
    if (map) {
      out.push_back(with_prediction(basis, std::move(estimate), truth, posterior_size(basis, c),
                                    measured.floor));
    } else {
      const BrdfError error = brdf_error(estimate, truth, measured.floor);
      out.push_back({error, nan, nan, nan, std::move(estimate)});
    }
  }
  return out;
}

std::vector<MaterialResult> estimate_mean(const BrdfBasis& basis, std::span<const Material> test,
                                          double floor) {
  const BrdfTable mean = evaluate(basis, Eigen::MatrixXd::Zero(basis.components(), basis.channels));
  std::vector<MaterialResult> out;
  for (const Material& material : test) {
    out.push_back({brdf_error(mean, material.table, floor), nan, nan, nan, mean});
  }
  return out;
}

std::vector<MaterialResult> bivariate_error(std::span<const Material> test, double floor) {
  std::vector<MaterialResult> out;
  for (const Material& material : test) {
    MaterialResult result{{}, nan, nan, nan, material.table};
    double error = 0, norm = 0;
    std::vector<double> all;
    for (Eigen::Index row = 0; row < material.azimuth.rows(); ++row) {
      const Eigen::Index cell = row / azimuth_bins;
      for (Eigen::Index channel = 0; channel < material.azimuth.cols(); ++channel) {
        const double f = material.table.f(cell, channel);
        if (!std::isfinite(f)) continue;
        const double departure = static_cast<double>(material.azimuth(row, channel));
        const double ln = std::log(std::max(f, floor)) + departure;
        error += departure * departure;
        norm += ln * ln;
        all.push_back(std::abs(departure));
      }
    }
    if (norm > 0) result.error.percent_log = 100 * std::sqrt(error / norm);
    if (!all.empty()) {
      const auto middle = all.begin() + static_cast<std::ptrdiff_t>(all.size() / 2);
      std::nth_element(all.begin(), middle, all.end());
      result.error.median_abs_log = *middle;
    }
    out.push_back(std::move(result));
  }
  return out;
}

}  // namespace lightrig
