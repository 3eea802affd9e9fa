#include <algorithm>
#include <cmath>
#include <limits>

#include "core/check.h"
#include "core/fit.h"

namespace lightrig {
namespace {

/// Variance of mean + V c at every row of a block, posterior and model error together.
Eigen::ArrayXd row_variance(const BrdfBasis& basis, Eigen::Index first, Eigen::Index rows,
                            const Eigen::MatrixXd& covariance) {
  const Eigen::MatrixXd block = basis.V.middleRows(first, rows);
  const Eigen::MatrixXd product = block * covariance.selfadjointView<Eigen::Lower>();
  return product.cwiseProduct(block).rowwise().sum().array().max(0.0) +
         basis.unsaid_sigma * basis.unsaid_sigma;
}

/// Sums over the valid grid and the channels, in ln units.
struct LogNorms {
  double error2 = 0;  ///< expected ‖ln f̂ − ln f‖²
  double ln2 = 0;     ///< ‖ln f̂‖²
  double percent() const { return ln2 + error2 > 0 ? 100 * std::sqrt(error2 / (ln2 + error2)) : 0; }
};

/// From mapped units to those of ln f.
Eigen::ArrayXXd in_ln(const BrdfBasis& basis, const BrdfTable& brdf, Eigen::ArrayXXd stddev) {
  if (basis.mapping.kind == Mapping::ln_floor) return stddev;
  for (int cell = 0; cell < basis.grid.cells(); ++cell) {
    if (!basis.valid[static_cast<std::size_t>(cell)]) continue;
    for (Eigen::Index channel = 0; channel < stddev.cols(); ++channel)
      stddev(cell, channel) *= ln_slope(basis.mapping, cell, brdf.f(cell, channel));
  }
  return stddev;
}

/// `stddev` (cells × C) of ln f.
LogNorms log_norms(const BrdfBasis& basis, const BrdfTable& brdf, const Eigen::ArrayXXd& stddev) {
  LogNorms norms;
  for (int cell = 0; cell < basis.grid.cells(); ++cell) {
    if (!basis.valid[static_cast<std::size_t>(cell)]) continue;
    for (Eigen::Index channel = 0; channel < brdf.f.cols(); ++channel) {
      const double f = brdf.f(cell, channel);
      const double ln_f = std::log(std::max(f, basis.mapping.floor));
      norms.ln2 += ln_f * ln_f;
      norms.error2 += stddev(cell, channel) * stddev(cell, channel);
    }
  }
  return norms;
}

Eigen::ArrayXXd stddev_of(const BrdfBasis& basis, std::span<const Eigen::MatrixXd> covariance,
                          Eigen::Index channels) {
  const int cells = basis.grid.cells();
  Eigen::ArrayXXd out(cells, channels);
  for (int channel = 0; channel < channels; ++channel) {
    const std::size_t at = covariance.size() == 1 ? 0 : static_cast<std::size_t>(channel);
    out.col(channel) = row_variance(basis, basis.row(0, channel), cells, covariance[at]).sqrt();
  }
  for (int cell = 0; cell < cells; ++cell) {
    if (!basis.valid[static_cast<std::size_t>(cell)]) {
      out.row(cell) = std::numeric_limits<double>::quiet_NaN();
    }
  }
  return out;
}

}  // namespace

double ln_slope(const LogMapping& mapping, int cell, double f) {
  if (mapping.kind == Mapping::ln_floor) return 1;
  const double g = std::max(f, mapping.floor);
  return 1 / (g * map_slope(mapping, cell, f));
}

PosteriorSize posterior_size(const BrdfBasis& basis, std::span<const Eigen::MatrixXd> covariance,
                             const Eigen::MatrixXd& c) {
  CHECK(covariance.size() == static_cast<std::size_t>(c.cols()));
  const Eigen::VectorXd precision = basis.stddev.cwiseAbs2().cwiseInverse();
  PosteriorSize size;
  size.columns = c.cols();
  for (Eigen::Index i = 0; i < c.cols(); ++i) {
    const Eigen::MatrixXd& one = covariance[static_cast<std::size_t>(i)];
    size.trace += one.trace();
    size.freedom += static_cast<double>(c.rows()) - one.diagonal().dot(precision);
    size.z2 += c.col(i).cwiseQuotient(basis.stddev).squaredNorm();
  }
  return size;
}

PosteriorSize posterior_size(const BrdfBasis& basis, const Coefficients& fitted) {
  PosteriorSize size = posterior_size(basis, fitted.covariance, fitted.c);
  const std::int64_t rows = fitted.rows_value + fitted.rows_censored;
  if (rows > 0)
    size.censored = static_cast<double>(fitted.rows_censored) / static_cast<double>(rows);
  return size;
}

ErrorInterval error_interval(const BrdfBasis& basis, const PosteriorSize& size) {
  const ErrorCalibration& k = basis.calibration;
  const double usual = 1.6448536269514722 * k.spread;
  const ErrorBand exact = k.exact.high > k.exact.low ? k.exact : ErrorBand{-usual, usual};
  const double known = k.censored_share > 0 ? k.censored_share : 1;
  // Beyond what was tried the band widens on, but not for ever.
  const double u = k.censored_share > 0 ? std::min(size.censored / known, 2.0) : 0;
  return {std::exp(exact.low + u * (k.censored.low - exact.low)),
          std::exp(exact.high + u * (k.censored.high - exact.high))};
}

double calibration_factor(const BrdfBasis& basis, const PosteriorSize& size) {
  const double prior = basis.stddev.squaredNorm() * static_cast<double>(size.columns);
  const double learnt = std::clamp(1 - size.trace / prior, 0.0, 1.0);
  const ErrorCalibration& k = basis.calibration;
  const bool measured = size.z2 > 0 && size.freedom > 1e-9;
  const double surprise = measured ? 0.5 * std::log(size.z2 / size.freedom) : k.typical_surprise;
  const double shift = k.censored_shift * std::min(size.censored, 2 * k.censored_share);
  return std::exp(learnt * (k.offset + k.slope * surprise + shift));
}

double predicted_error_percent(const BrdfBasis& basis, const PosteriorSize& size, double ln2,
                               Eigen::Index channels) {
  const auto valid = std::count(basis.valid.begin(), basis.valid.end(), 1);
  const double unsaid =
      basis.unsaid_sigma * basis.unsaid_sigma * static_cast<double>(valid * channels);
  LogNorms norms;
  norms.ln2 = ln2;
  norms.error2 = (size.trace + unsaid) * std::pow(calibration_factor(basis, size), 2);
  return norms.percent();
}

Reconstruction reconstruct(const BrdfBasis& basis, const Coefficients& coefficients) {
  CHECK(coefficients.covariance.size() == static_cast<std::size_t>(coefficients.c.cols()));
  Reconstruction out;
  out.brdf = evaluate(basis, coefficients.c, &out.clipped_cells);
  out.log_stddev =
      in_ln(basis, out.brdf, stddev_of(basis, coefficients.covariance, out.brdf.f.cols()));
  const PosteriorSize size = posterior_size(basis, coefficients);
  out.log_stddev *= calibration_factor(basis, size);
  out.predicted_error_percent = log_norms(basis, out.brdf, out.log_stddev).percent();
  const ErrorInterval interval = error_interval(basis, size);
  out.predicted_low_percent = out.predicted_error_percent * interval.low;
  out.predicted_high_percent = out.predicted_error_percent * interval.high;
  return out;
}

double predicted_error_percent(const BrdfBasis& basis, std::span<const Eigen::MatrixXd> covariance,
                               const Eigen::MatrixXd& c) {
  CHECK(covariance.size() == static_cast<std::size_t>(c.cols()));
  const BrdfTable brdf = evaluate(basis, c);
  const PosteriorSize size = posterior_size(basis, covariance, c);
  const bool whole = basis.layout == ChannelLayout::columns || c.cols() == 1;
  if (basis.mapping.kind != Mapping::ln_floor || !whole) {
    const Eigen::ArrayXXd stddev = calibration_factor(basis, size) *
                                   in_ln(basis, brdf, stddev_of(basis, covariance, brdf.f.cols()));
    return log_norms(basis, brdf, stddev).percent();
  }
  // V's columns are orthonormal: the trace over the grid is the trace of the coefficients.
  const Eigen::ArrayXXd none = Eigen::ArrayXXd::Zero(brdf.f.rows(), brdf.f.cols());
  return predicted_error_percent(basis, size, log_norms(basis, brdf, none).ln2, brdf.f.cols());
}

}  // namespace lightrig
