#include "core/fit.h"

#include <Eigen/QR>
#include <algorithm>
#include <cmath>
#include <limits>
#include <map>

#include "core/check.h"
#include "core/fit_map.h"
#include "core/svd.h"

namespace lightrig {
namespace {

/// All observations of one cell and channel, over the lights.
struct CellRows {
  double weight = 0, weighted_f = 0, weighted_variance = 0;
  double above = -std::numeric_limits<double>::infinity();  ///< [1/sr] f is at least this
  double below = std::numeric_limits<double>::infinity();   ///< [1/sr] f is at most this
};

using RowsByCell = std::map<std::pair<int, int>, CellRows>;  // (channel, cell), sorted

RowsByCell collect(const BrdfBasis& basis, std::span<const BrdfObservations> lights, int channels) {
  RowsByCell rows;
  for (const BrdfObservations& light : lights) {
    for (const BrdfObservation& o : light.rows) {
      if (o.channel >= channels || !basis.valid[static_cast<std::size_t>(o.cell)]) continue;
      CellRows& row = rows[{o.channel, o.cell}];
      if (o.kind == BrdfObservation::Kind::above) {
        row.above = std::max(row.above, o.f);
      } else if (o.kind == BrdfObservation::Kind::below) {
        row.below = std::min(row.below, o.f);
      } else if (std::isfinite(o.f) && std::isfinite(o.variance)) {
        // Weights f/v: photon noise makes v grow with f, and 1/v alone would favour whichever
        // light happened to measure less.
        const double f = std::max(o.f, basis.mapping.floor);
        const double v = std::max(o.variance, 1e-16 * f * f);
        row.weight += f / v;
        row.weighted_f += f / v * o.f;
        row.weighted_variance += f / v * (f / v) * o.variance;
      }
    }
  }
  return rows;
}

/// Rows of one problem (one channel, or all channels of a stacked basis) in mapped units.
DesignRows design_rows(const BrdfBasis& basis, const RowsByCell& rows, int first_channel,
                       int last_channel, bool censored) {
  DesignRows d;
  std::vector<Eigen::Index> basis_rows;
  const auto push = [&](int channel, int cell, BrdfObservation::Kind kind, double f,
                        double variance) {
    const double slope = map_slope(basis.mapping, cell, f);
    const Eigen::Index row = basis.row(cell, channel);
    double y = map_value(basis.mapping, cell, f);
    // At or below the floor of ln_floor all values are one: such a bound is a measurement.
    if (kind == BrdfObservation::Kind::below && basis.mapping.kind == Mapping::ln_floor &&
        f <= basis.mapping.floor) {
      kind = BrdfObservation::Kind::value;
      y = std::log(basis.mapping.floor);
    }
    basis_rows.push_back(row);
    d.kind.push_back(kind);
    d.y.push_back(y - basis.mean[row]);
    d.noise_variance.push_back(slope * slope * variance);
  };
  for (const auto& [key, row] : rows) {
    const auto [channel, cell] = key;
    if (channel < first_channel || channel > last_channel) continue;
    if (row.weight > 0) {
      push(channel, cell, BrdfObservation::Kind::value, row.weighted_f / row.weight,
           row.weighted_variance / (row.weight * row.weight));
      continue;  // a measured value says more than any bound
    }
    if (!censored) continue;
    if (std::isfinite(row.above)) push(channel, cell, BrdfObservation::Kind::above, row.above, 0);
    if (std::isfinite(row.below)) push(channel, cell, BrdfObservation::Kind::below, row.below, 0);
  }
  d.G.resize(static_cast<Eigen::Index>(basis_rows.size()), basis.components());
  for (std::size_t i = 0; i < basis_rows.size(); ++i) {
    d.G.row(static_cast<Eigen::Index>(i)) = basis.V.row(basis_rows[i]);
  }
  return d;
}

/// c = G⁺ y by a complete orthogonal decomposition; covariance σ²(GᵀG)⁺ where the rows determine c,
/// the prior's where they do not.
Posterior fit_pseudo_inverse(const DesignRows& rows, const Eigen::VectorXd& stddev, double sigma) {
  const Eigen::Index k = stddev.size(), m = rows.G.rows();
  Posterior out;
  out.c = Eigen::VectorXd::Zero(k);
  out.covariance = stddev.cwiseAbs2().asDiagonal();
  out.weight.assign(static_cast<std::size_t>(m), 1.0);
  if (m == 0) return out;
  const Eigen::Map<const Eigen::VectorXd> y(rows.y.data(), m);
  const double tolerance =
      static_cast<double>(std::max(m, k)) * std::numeric_limits<double>::epsilon();
  Eigen::CompleteOrthogonalDecomposition<Eigen::MatrixXd> qr;
  qr.setThreshold(tolerance);
  qr.compute(rows.G);
  out.c = qr.solve(y);
  const RightSingular svd = right_singular(rows.G);
  const Eigen::VectorXd& d = svd.values;
  while (out.rank < d.size() && d[out.rank] > tolerance * d[0]) ++out.rank;
  const Eigen::MatrixXd seen = svd.V.leftCols(out.rank);
  const Eigen::MatrixXd unseen = svd.V.rightCols(k - out.rank);
  const Eigen::VectorXd spread = sigma * d.head(out.rank).cwiseInverse();
  const Eigen::MatrixXd from_rows = seen * spread.asDiagonal();
  const Eigen::MatrixXd from_prior = unseen * (unseen.transpose() * stddev.asDiagonal());
  out.covariance = from_rows * from_rows.transpose() + from_prior * from_prior.transpose();
  return out;
}

int rank_of(const DesignRows& rows) {
  if (rows.G.rows() == 0) return 0;
  Eigen::ColPivHouseholderQR<Eigen::MatrixXd> qr;
  qr.setThreshold(static_cast<double>(std::max(rows.G.rows(), rows.G.cols())) *
                  std::numeric_limits<double>::epsilon());
  qr.compute(rows.G);
  return static_cast<int>(qr.rank());
}

}  // namespace

Coefficients fit(const BrdfBasis& basis, std::span<const BrdfObservations> lights, int channels,
                 const FitOptions& options) {
  const bool stacked = basis.layout == ChannelLayout::stacked;
  CHECK(channels >= 1 && (!stacked || channels == basis.channels));
  const bool joint = stacked && options.estimator == Estimator::map;
  const bool map = options.estimator == Estimator::map;
  const double sigma = options.model_sigma > 0 ? options.model_sigma : basis.model_sigma;
  const RowsByCell rows = collect(basis, lights, channels);
  const int columns = joint ? 1 : channels;
  Coefficients out;
  out.c.resize(basis.components(), columns);
  out.rank = std::numeric_limits<int>::max();
  double squares = 0;
  Eigen::MatrixXd ranked(0, basis.components());
  int rank = 0;
  for (int column = 0; column < columns; ++column) {
    const int last = joint ? channels - 1 : column;
    const DesignRows d = design_rows(basis, rows, column, last, map && options.use_censored);
    Posterior p = map ? fit_map(d, basis.stddev, sigma, options.outlier_sigma)
                      : fit_pseudo_inverse(d, basis.stddev, sigma);
    if (map && options.find_rank) {
      // Channels mostly see the same cells: one decomposition serves them all.
      const bool same = d.G.rows() == ranked.rows() && d.G == ranked;
      p.rank = same ? rank : rank_of(d);
      rank = p.rank;
      ranked = d.G;
    }
    const Eigen::VectorXd predicted = d.G * p.c;
    for (std::size_t i = 0; i < d.y.size(); ++i) {
      const bool value = d.kind[i] == BrdfObservation::Kind::value;
      ++(value ? out.rows_value : out.rows_censored);
      if (value) squares += std::pow(d.y[i] - predicted[static_cast<Eigen::Index>(i)], 2);
    }
    out.rank = std::min(out.rank, p.rank);
    out.c.col(column) = p.c;
    out.covariance.push_back(std::move(p.covariance));
  }
  if (out.rows_value > 0)
    out.residual_rms = std::sqrt(squares / static_cast<double>(out.rows_value));
  return out;
}

}  // namespace lightrig
