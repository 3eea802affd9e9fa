#include <algorithm>
#include <cmath>
#include <limits>

#include "core/check.h"
#include "core/fit.h"

namespace lightrig {
namespace {

/// d ln f/dy of the mapping at f: 1 for a plain logarithm.
double ln_slope(const LogMapping& mapping, int cell, double f) {
  if (mapping.kind == Mapping::ln_floor) return 1;
  const double g = std::max(f, mapping.floor);
  return 1 / (g * map_slope(mapping, cell, f));
}

/// Variance of mean + V c at every row of a block, posterior and model error together.
Eigen::ArrayXd row_variance(const BrdfBasis& basis, Eigen::Index first, Eigen::Index rows,
                            const Eigen::MatrixXd& covariance) {
  const Eigen::MatrixXd block = basis.V.middleRows(first, rows);
  const Eigen::MatrixXd product = block * covariance.selfadjointView<Eigen::Lower>();
  return product.cwiseProduct(block).rowwise().sum().array().max(0.0) +
         basis.model_sigma * basis.model_sigma;
}

/// Sums over the valid grid and the channels, in ln units.
struct LogNorms {
  double error2 = 0;  ///< expected ‖ln f̂ − ln f‖²
  double ln2 = 0;     ///< ‖ln f̂‖²
  double percent() const { return ln2 + error2 > 0 ? 100 * std::sqrt(error2 / (ln2 + error2)) : 0; }
};

LogNorms log_norms(const BrdfBasis& basis, const BrdfTable& brdf, const Eigen::ArrayXXd& stddev) {
  LogNorms norms;
  for (int cell = 0; cell < basis.grid.cells(); ++cell) {
    if (!basis.valid[static_cast<std::size_t>(cell)]) continue;
    for (Eigen::Index channel = 0; channel < brdf.f.cols(); ++channel) {
      const double f = brdf.f(cell, channel);
      const double ln_f = std::log(std::max(f, basis.mapping.floor));
      const double ln_stddev = stddev(cell, channel) * ln_slope(basis.mapping, cell, f);
      norms.ln2 += ln_f * ln_f;
      norms.error2 += ln_stddev * ln_stddev;
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

Reconstruction reconstruct(const BrdfBasis& basis, const Coefficients& coefficients) {
  CHECK(coefficients.covariance.size() == static_cast<std::size_t>(coefficients.c.cols()));
  Reconstruction out;
  out.brdf = evaluate(basis, coefficients.c, &out.clipped_cells);
  out.log_stddev = stddev_of(basis, coefficients.covariance, out.brdf.f.cols());
  out.predicted_error_percent = log_norms(basis, out.brdf, out.log_stddev).percent();
  // The spread between materials of what a basis cannot say is close to log-normal.
  const double factor = std::exp(1.6448536269514722 * basis.model_sigma_spread);
  out.predicted_low_percent = out.predicted_error_percent / factor;
  out.predicted_high_percent = out.predicted_error_percent * factor;
  return out;
}

double predicted_error_percent(const BrdfBasis& basis, std::span<const Eigen::MatrixXd> covariance,
                               const Eigen::MatrixXd& c) {
  CHECK(covariance.size() == static_cast<std::size_t>(c.cols()));
  const BrdfTable brdf = evaluate(basis, c);
  const bool whole = basis.layout == ChannelLayout::columns || c.cols() == 1;
  if (basis.mapping.kind != Mapping::ln_floor || !whole) {
    return log_norms(basis, brdf, stddev_of(basis, covariance, brdf.f.cols())).percent();
  }
  // V's columns are orthonormal: the trace over the grid is the trace of the coefficients.
  LogNorms norms = log_norms(basis, brdf, Eigen::ArrayXXd::Zero(brdf.f.rows(), brdf.f.cols()));
  const auto valid = std::count(basis.valid.begin(), basis.valid.end(), 1);
  norms.error2 = basis.model_sigma * basis.model_sigma * static_cast<double>(valid * brdf.f.cols());
  for (const Eigen::MatrixXd& one : covariance) norms.error2 += one.trace();
  return norms.percent();
}

}  // namespace lightrig
