#include "core/leave_out_trials.h"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <limits>

#include "core/censored_rows.h"

namespace lightrig {
namespace {

constexpr double ninety = 1.6448536269514722;  // deviations that hold 90 % of a normal
/// Some tens of fits tell no quantile; their deviation then says more.
constexpr std::size_t least_for_quantiles = 40;

/// Sums over the columns (channels) of one material.
struct TrialSums {
  double error2 = 0, expected2 = 0, z2 = 0, freedom = 0;
  Trial trial(double censored) const {
    constexpr double tiny = std::numeric_limits<double>::min();
    return {0.5 * std::log(std::max(error2, tiny) / std::max(expected2, tiny)),
            0.5 * std::log(std::max(z2, tiny) / std::max(freedom, tiny)), censored};
  }
};

/// The value that a share of the sorted ones lies below, between neighbours linearly.
double quantile(const std::vector<double>& sorted, double share) {
  const double at = share * static_cast<double>(sorted.size() - 1);
  const auto i = std::min(static_cast<std::size_t>(at), sorted.size() - 2);
  const double u = at - static_cast<double>(i);
  return (1 - u) * sorted[i] + u * sorted[i + 1];
}

/// The range about the median that leaves a tenth of the values outside.
double range_of_nine_tenths(std::vector<double> values, double median) {
  for (double& value : values) value = std::abs(std::log(value / median));
  const auto at = values.begin() + static_cast<std::ptrdiff_t>(values.size() * 9 / 10);
  std::nth_element(values.begin(), at, values.end());
  return std::exp(2 * *at);
}

/// Rows of one material as a bracket that spans `range` about their median has them, nine tenths of
/// them where it is 0: what is darker or brighter is known to be beyond a level and no more.
struct ClippedRows {
  std::vector<Eigen::VectorXd> y;  ///< one per column
  std::vector<std::vector<BrdfObservation::Kind>> kind;
  double share = 0;  ///< of rows clipped
};
ClippedRows clipped(const BrdfBasis& basis, const Training& training, const FoldFits& fits,
                    const std::vector<Eigen::Index>& rows, std::size_t first, std::size_t last,
                    double range) {
  const auto cell_of = [&](Eigen::Index i) {
    return static_cast<int>(rows[static_cast<std::size_t>(i)] % basis.grid.cells());
  };
  const auto offset = [&](Eigen::Index i) {
    return training.mean[rows[static_cast<std::size_t>(i)]] + fits.mean()[i];
  };
  std::vector<double> values;
  for (std::size_t j = first; j < last; ++j) {
    const auto y = fits.y().col(static_cast<Eigen::Index>(j));
    for (Eigen::Index i = 0; i < y.size(); ++i) {
      values.push_back(unmap_value(basis.mapping, cell_of(i), y[i] + offset(i)));
    }
  }
  std::vector<double> sorted = values;
  const auto middle = sorted.begin() + static_cast<std::ptrdiff_t>(sorted.size() / 2);
  std::nth_element(sorted.begin(), middle, sorted.end());
  if (range == 0) range = range_of_nine_tenths(values, *middle);
  const double low = *middle / std::sqrt(range), high = *middle * std::sqrt(range);
  ClippedRows out;
  std::size_t count = 0, at = 0;
  for (std::size_t j = first; j < last; ++j) {
    Eigen::VectorXd y = fits.y().col(static_cast<Eigen::Index>(j));
    std::vector<BrdfObservation::Kind> kind;
    for (Eigen::Index i = 0; i < y.size(); ++i) {
      const double f = values[at++];
      // At or below the logarithm's floor all values are one: a bound there is a measurement.
      const bool below = f < low && low > basis.mapping.floor, above = f > high;
      kind.push_back(below   ? BrdfObservation::Kind::below
                     : above ? BrdfObservation::Kind::above
                             : BrdfObservation::Kind::value);
      if (!below && !above) continue;
      y[i] = map_value(basis.mapping, cell_of(i), below ? low : high) - offset(i);
      ++count;
    }
    out.y.push_back(std::move(y));
    out.kind.push_back(std::move(kind));
  }
  out.share = static_cast<double>(count) / static_cast<double>(values.size());
  return out;
}

ErrorBand band_of(std::vector<double> left) {
  std::sort(left.begin(), left.end());
  return {quantile(left, 0.05), quantile(left, 0.95)};
}

/// Least squares of ln_ratio on surprise, and what scatter remains.
ErrorCalibration regress(std::span<const Trial> all) {
  const auto n = static_cast<double>(all.size());
  double x = 0, y = 0, xx = 0, xy = 0, yy = 0;
  for (const Trial& t : all) {
    x += t.surprise / n;
    y += t.ln_ratio / n;
    xx += t.surprise * t.surprise / n;
    xy += t.surprise * t.ln_ratio / n;
    yy += t.ln_ratio * t.ln_ratio / n;
  }
  ErrorCalibration calibration;
  const double variance = xx - x * x;
  calibration.slope = variance > 1e-12 ? std::clamp((xy - x * y) / variance, 0.0, 1.5) : 0;
  calibration.offset = y - calibration.slope * x;
  calibration.typical_surprise = x;
  const double left = yy - y * y - 2 * calibration.slope * (xy - x * y) +
                      calibration.slope * calibration.slope * variance;
  calibration.spread = std::sqrt(std::max(left, 1e-4));
  std::vector<double> remains;
  for (const Trial& t : all) {
    remains.push_back(t.ln_ratio - calibration.offset - calibration.slope * t.surprise);
  }
  const double band = ninety * calibration.spread;
  calibration.exact =
      remains.size() < least_for_quantiles ? ErrorBand{-band, band} : band_of(std::move(remains));
  return calibration;
}

/// What censoring adds: a shift in proportion to the share of rows, and a band that is no narrower
/// than without.
void add_censored(ErrorCalibration& calibration, std::span<const Trial> all) {
  if (all.size() < 10) return;
  double share = 0, xx = 0, xy = 0;
  std::vector<double> remains;
  for (const Trial& t : all) {
    remains.push_back(t.ln_ratio - calibration.offset - calibration.slope * t.surprise);
    share += t.censored / static_cast<double>(all.size());
    xx += t.censored * t.censored;
    xy += t.censored * remains.back();
  }
  calibration.censored_share = share;
  calibration.censored_shift = xy / xx;
  double squares = 0;
  for (std::size_t i = 0; i < all.size(); ++i) {
    remains[i] -= calibration.censored_shift * all[i].censored;
    squares += remains[i] * remains[i] / static_cast<double>(all.size());
  }
  const double deviation = ninety * std::sqrt(squares);
  const ErrorBand band = all.size() < least_for_quantiles ? ErrorBand{-deviation, deviation}
                                                          : band_of(std::move(remains));
  calibration.censored = {std::min(band.low, calibration.exact.low),
                          std::max(band.high, calibration.exact.high)};
}

}  // namespace

FoldFits::FoldFits(const Fold& fold, const Training& training,
                   const std::vector<Eigen::Index>& rows, const Eigen::VectorXd& stddev)
    : fold_(fold), stddev_(stddev) {
  Eigen::MatrixXd inside = training.X(rows, fold.in);
  const Eigen::VectorXd mean = inside.rowwise().mean();
  inside.colwise() -= mean;
  const Eigen::MatrixXd scale =
      fold.spectrum.U *
      fold.spectrum.lambda.cwiseSqrt().cwiseInverse().cwiseProduct(stddev).asDiagonal();
  GS_ = inside * scale;
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> solver(GS_ * GS_.transpose());
  d_ = solver.eigenvalues().cwiseMax(0.0);
  QtGS_ = solver.eigenvectors().transpose() * GS_;
  Eigen::MatrixXd y = training.X(rows, fold.out);
  y.colwise() -= mean;
  Qty_ = solver.eigenvectors().transpose() * y;
  y_ = std::move(y);
  mean_ = mean;
}

Eigen::MatrixXd FoldFits::estimate(double row_variance) const {
  return QtGS_.transpose() * ((d_.array() + row_variance).inverse().matrix().asDiagonal() * Qty_);
}

Eigen::VectorXd FoldFits::variance(double row_variance) const {
  const Eigen::MatrixXd half =
      (d_.array() + row_variance).sqrt().inverse().matrix().asDiagonal() * QtGS_;
  return (1 - half.colwise().squaredNorm().transpose().array()).max(0.0);
}
std::vector<Trial> trials(const FoldFits& fits, const Training& training, double row_variance,
                          double unsaid2) {
  const Fold& fold = fits.fold();
  const Eigen::MatrixXd z = fits.estimate(row_variance);
  const Eigen::VectorXd var = fits.variance(row_variance);
  const Eigen::VectorXd s2 = fits.stddev().cwiseAbs2();
  const double expected2 = s2.dot(var) + unsaid2;
  const double freedom = static_cast<double>(var.size()) - var.sum();
  std::vector<Trial> out;
  for (std::size_t j = 0; j < fold.out.size();) {
    const int material = training.material_of[static_cast<std::size_t>(fold.out[j])];
    TrialSums sums;
    for (; j < fold.out.size() &&
           training.material_of[static_cast<std::size_t>(fold.out[j])] == material;
         ++j) {
      const auto column = static_cast<Eigen::Index>(j);
      const Eigen::VectorXd c = fits.stddev().cwiseProduct(z.col(column));
      sums.error2 += (c - fold.c.col(column)).squaredNorm() + fold.residual2[column];
      sums.expected2 += expected2;
      sums.freedom += freedom;
      sums.z2 += z.col(column).squaredNorm();
    }
    out.push_back(sums.trial(0));
  }
  return out;
}

std::vector<Trial> clipped_trials(const BrdfBasis& basis, const FoldFits& fits,
                                  const Training& training, const std::vector<Eigen::Index>& rows,
                                  double sigma, int step, double unsaid2, double range) {
  const Fold& fold = fits.fold();
  const RowProblem problem = row_problem(fits.GS(), fits.stddev());
  std::vector<Trial> out;
  for (std::size_t j = 0; j < fold.out.size();) {
    const std::size_t first = j;
    const int material = training.material_of[static_cast<std::size_t>(fold.out[j])];
    while (j < fold.out.size() &&
           training.material_of[static_cast<std::size_t>(fold.out[j])] == material) {
      ++j;
    }
    const ClippedRows seen = clipped(basis, training, fits, rows, first, j, range);
    if (seen.share <= 0) continue;
    TrialSums sums;
    for (std::size_t i = first; i < j; ++i) {
      const RowPosterior p =
          fit_rows(problem, seen.y[i - first], seen.kind[i - first], sigma, step);
      const Eigen::VectorXd z = fits.GS().transpose() * p.a;
      const auto column = static_cast<Eigen::Index>(i);
      sums.error2 += (fits.stddev().cwiseProduct(z) - fold.c.col(column)).squaredNorm() +
                     fold.residual2[column];
      sums.expected2 += fits.stddev().squaredNorm() - p.told + unsaid2;
      sums.freedom += p.freedom;
      sums.z2 += z.squaredNorm();
    }
    out.push_back(sums.trial(seen.share));
  }
  return out;
}

ErrorCalibration calibrated(std::span<const Trial> exact, std::span<const Trial> clipped) {
  ErrorCalibration calibration = regress(exact);
  add_censored(calibration, clipped);
  return calibration;
}

}  // namespace lightrig
