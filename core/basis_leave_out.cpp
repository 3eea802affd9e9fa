#include <Eigen/Eigenvalues>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
#include <optional>
#include <span>
#include <vector>

#include "core/basis_training.h"
#include "core/check.h"
#include "core/leave_out_trials.h"
#include "core/parallel.h"

namespace lightrig {
namespace {

/// Inner products after the mean of the training columns is taken from both sides.
struct CentredGram {
  Eigen::MatrixXd inner;  ///< (in × in)
  Eigen::MatrixXd cross;  ///< (in × out)
  Eigen::VectorXd norm2;  ///< (out) squared norms of the held-out columns
};
CentredGram centred(const Eigen::MatrixXd& K, const std::vector<Eigen::Index>& in,
                    const std::vector<Eigen::Index>& out) {
  CentredGram g{K(in, in), K(in, out), K.diagonal()(out)};
  const Eigen::VectorXd row_mean = g.inner.rowwise().mean();
  const double all_mean = row_mean.mean();
  const Eigen::RowVectorXd cross_mean = g.cross.colwise().mean();
  g.inner.colwise() -= row_mean;
  g.inner.rowwise() -= row_mean.transpose();
  g.inner.array() += all_mean;
  g.cross.colwise() -= row_mean;
  g.cross.rowwise() -= cross_mean;
  g.cross.array() += all_mean;
  g.norm2 += (all_mean - 2 * cross_mean.array()).matrix().transpose();
  return g;
}

std::vector<Fold> make_folds(const BrdfBasis& basis, const Training& training,
                             const Eigen::MatrixXd& K, int folds) {
  std::vector<Fold> out;
  folds = std::min(folds, training.groups);
  for (int f = 0; f < folds; ++f) {
    Fold fold;
    for (Eigen::Index j = 0; j < K.cols(); ++j) {
      const bool held = training.group_of[static_cast<std::size_t>(j)] % folds == f;
      (held ? fold.out : fold.in).push_back(j);
    }
    if (fold.in.size() < 3 || fold.out.empty()) return {};
    const CentredGram g = centred(K, fold.in, fold.out);
    fold.spectrum = spectrum(g.inner, training.X.rows());
    const Eigen::Index k = std::min(basis.components(), fold.spectrum.lambda.size());
    if (k == 0) return {};
    fold.spectrum.lambda = Eigen::VectorXd(fold.spectrum.lambda.head(k));
    fold.spectrum.U = Eigen::MatrixXd(fold.spectrum.U.leftCols(k));
    fold.c = fold.spectrum.lambda.cwiseSqrt().cwiseInverse().asDiagonal() *
             (fold.spectrum.U.transpose() * g.cross);
    fold.residual2 = (g.norm2 - fold.c.colwise().squaredNorm().transpose()).cwiseMax(0.0);
    out.push_back(std::move(fold));
  }
  return out;
}

/// A curve over component indices read at another number of components, ln-linearly.
Eigen::VectorXd resampled(const Eigen::VectorXd& curve, Eigen::Index k) {
  if (curve.size() == 1) return Eigen::VectorXd::Constant(k, curve[0]);
  Eigen::VectorXd out(k);
  for (Eigen::Index i = 0; i < k; ++i) {
    const double x = k == 1 ? 0
                            : static_cast<double>(i) * static_cast<double>(curve.size() - 1) /
                                  static_cast<double>(k - 1);
    const auto j = std::min(static_cast<Eigen::Index>(x), curve.size() - 2);
    const double u = x - static_cast<double>(j);
    out[i] = std::exp((1 - u) * std::log(curve[j]) + u * std::log(curve[j + 1]));
  }
  return out;
}

/// Deviations of the coefficients of materials that did not make the basis. A training deviation
/// falls to nothing at the last components only because they were made to fit; an unseen material's
/// does not.
Eigen::VectorXd unseen_stddev(const std::vector<Fold>& folds, Eigen::Index k) {
  Eigen::VectorXd ln = Eigen::VectorXd::Zero(k);
  for (const Fold& fold : folds) {
    Eigen::VectorXd mean_square =
        fold.c.rowwise().squaredNorm() / static_cast<double>(fold.out.size());
    mean_square =
        mean_square.cwiseMax(1e-14 * mean_square.maxCoeff() + std::numeric_limits<double>::min());
    ln += resampled(mean_square, k).array().log().matrix() / static_cast<double>(folds.size());
  }
  // Neighbouring components differ by chance only: a short mean in ln, then never rising.
  Eigen::VectorXd stddev(k);
  for (Eigen::Index i = 0; i < k; ++i) {
    const Eigen::Index reach = std::min<Eigen::Index>({i / 3, k - 1 - i, 5});
    stddev[i] = std::exp(ln.segment(i - reach, 2 * reach + 1).mean() / 2);
    if (i > 0) stddev[i] = std::min(stddev[i], stddev[i - 1]);
  }
  return stddev;
}

/// Rows that `lights` distant lights would show: as many columns of θd, evenly over 0 … 80°, all θh
/// of them (every `step`-th, which stands for its neighbours).
std::vector<Eigen::Index> rows_of_lights(const BrdfBasis& basis, int lights, int step) {
  std::vector<Eigen::Index> rows;
  const int channels = basis.layout == ChannelLayout::stacked ? basis.channels : 1;
  for (int channel = 0; channel < channels; ++channel) {
    for (int i = 0; i < lights; ++i) {
      const int i_d = static_cast<int>((i + 0.5) / lights * basis.grid.n_d * 8 / 9);
      for (int i_h = 0; i_h < basis.grid.n_h; i_h += step) {
        const int cell = basis.grid.cell(i_h, i_d);
        if (basis.valid[static_cast<std::size_t>(cell)]) rows.push_back(basis.row(cell, channel));
      }
    }
  }
  return rows;
}

double mean_error(const FoldFits& fits, double row_variance) {
  const Eigen::MatrixXd c = fits.stddev().asDiagonal() * fits.estimate(row_variance);
  return (c - fits.fold().c).colwise().norm().mean();
}

std::vector<Trial> together(const std::vector<std::vector<Trial>>& parts) {
  std::vector<Trial> pooled;
  for (const std::vector<Trial>& part : parts) {
    pooled.insert(pooled.end(), part.begin(), part.end());
  }
  return pooled;
}

/// Greatest, over folds, rows and columns left out, of what a column lies outside the range of the
/// columns within, in such ranges. Rows that all columns within agree on have none.
double range_slack(const Training& training, const std::vector<Fold>& folds) {
  const Eigen::Index rows = training.X.rows();
  const auto count = static_cast<Eigen::Index>(folds.size());
  Eigen::ArrayXXd low(rows, count), high(rows, count);
  for (Eigen::Index f = 0; f < count; ++f) {
    const std::vector<Eigen::Index>& out = folds[static_cast<std::size_t>(f)].out;
    low.col(f) = high.col(f) = training.X.col(out.front()).array();
    for (const Eigen::Index j : out) {
      low.col(f) = low.col(f).min(training.X.col(j).array());
      high.col(f) = high.col(f).max(training.X.col(j).array());
    }
  }
  double slack = 0;
  for (Eigen::Index f = 0; f < count; ++f) {
    Eigen::ArrayXd below = Eigen::ArrayXd::Constant(rows, std::numeric_limits<double>::infinity());
    Eigen::ArrayXd above = -below;
    for (Eigen::Index other = 0; other < count; ++other) {
      if (other == f) continue;
      below = below.min(low.col(other));
      above = above.max(high.col(other));
    }
    const Eigen::ArrayXd range = above - below;
    const Eigen::ArrayXd outside = (below - low.col(f)).max(high.col(f) - above);
    // A row where all lie at the floor has a range of rounding alone.
    const double least_range = 1e-9 * range.maxCoeff();
    for (Eigen::Index r = 0; r < rows; ++r) {
      if (range[r] > least_range) slack = std::max(slack, outside[r] / range[r]);
    }
  }
  return std::min(slack, 1.0);
}

}  // namespace

LeaveOut leave_materials_out(const BrdfBasis& basis, const Training& training,
                             const Eigen::MatrixXd& K, int folds, int threads) {
  LeaveOut out{basis.stddev, basis.model_sigma, basis.unsaid_sigma, basis.calibration, false};
  const std::vector<Fold> all = make_folds(basis, training, K, folds);
  const auto valid_cells = std::count(basis.valid.begin(), basis.valid.end(), 1);
  const double valid_rows =
      static_cast<double>(valid_cells * (training.X.rows() / basis.grid.cells()));
  if (all.empty()) {
    // No material can be spared to ask how the others serve it: that a new one lies in the span of
    // two or three is nothing to build on.
    out.unsaid_sigma =
        training.X.norm() / std::sqrt(static_cast<double>(training.X.cols() - 1) * valid_rows);
    out.calibration.spread = 2 * ErrorCalibration{}.spread;
    return out;
  }
  out.any = true;
  out.range_slack = range_slack(training, all);
  double unsaid2 = 0;
  for (const Fold& fold : all) unsaid2 += fold.residual2.mean() / static_cast<double>(all.size());
  out.unsaid_sigma = std::sqrt(unsaid2 / valid_rows);
  out.stddev = unseen_stddev(all, basis.components());

  struct Scene {
    int lights, step;
  };
  constexpr std::array<Scene, 3> scenes = {Scene{2, 1}, Scene{4, 2}, Scene{8, 4}};
  constexpr std::array<double, 5> factors = {0.7, 1.0, 1.5, 2.5, 4.0};
  // Every scene with every fold stands alone; sums are taken in their order, whoever did them.
  using Errors = std::array<double, factors.size()>;
  const auto folded = static_cast<std::int64_t>(all.size());
  std::vector<std::optional<FoldFits>> fits(scenes.size() * all.size());
  std::vector<Errors> errors(fits.size());
  const auto each = [&](std::size_t of_scenes, const auto& work) {
    parallel_ranges(static_cast<std::int64_t>(of_scenes) * folded, 1, threads,
                    [&](std::int64_t i, std::int64_t, int) {
                      work(static_cast<std::size_t>(i), static_cast<std::size_t>(i / folded),
                           all[static_cast<std::size_t>(i % folded)]);
                    });
  };
  each(scenes.size(), [&](std::size_t i, std::size_t s, const Fold& fold) {
    const Scene& scene = scenes[s];
    fits[i].emplace(fold, training, rows_of_lights(basis, scene.lights, scene.step),
                    resampled(out.stddev, fold.c.rows()));
    for (std::size_t k = 0; k < factors.size(); ++k) {
      const double sigma = factors[k] * std::max(out.unsaid_sigma, 1e-6);
      errors[i][k] = mean_error(*fits[i], sigma * sigma / scene.step);
    }
  });
  Errors error{};
  for (const Errors& one : errors) {
    for (std::size_t k = 0; k < factors.size(); ++k) error[k] += one[k];
  }
  const auto best =
      static_cast<std::size_t>(std::min_element(error.begin(), error.end()) - error.begin());
  out.model_sigma = factors[best] * std::max(out.unsaid_sigma, 1e-6);
  std::vector<std::vector<Trial>> exact(fits.size());
  each(scenes.size(), [&](std::size_t i, std::size_t s, const Fold&) {
    exact[i] =
        trials(*fits[i], training, out.model_sigma * out.model_sigma / scenes[s].step, unsaid2);
  });
  // One exposure of twelve bits, usable from 8 to 4,000 counts, and three of them a factor 8 apart.
  constexpr std::array<double, 2> bracket_ranges = {500, 32000};
  constexpr std::size_t enough = 10;
  const auto clipped_by = [&](std::span<const double> ranges) {
    constexpr std::array<Scene, 2> clipped_scenes = {Scene{2, 2}, Scene{8, 8}};
    std::vector<std::vector<Trial>> clipped(clipped_scenes.size() * all.size());
    each(clipped_scenes.size(), [&](std::size_t i, std::size_t s, const Fold& fold) {
      const auto [lights, step] = clipped_scenes[s];
      const std::vector<Eigen::Index> rows = rows_of_lights(basis, lights, step);
      const FoldFits fit(fold, training, rows, resampled(out.stddev, fold.c.rows()));
      for (const double range : ranges) {
        for (const Trial& trial :
             clipped_trials(basis, fit, training, rows, out.model_sigma, step, unsaid2, range)) {
          clipped[i].push_back(trial);
        }
      }
    });
    return together(clipped);
  };
  std::vector<Trial> clipped = clipped_by(bracket_ranges);
  // Materials that no such bracket clips may still meet a camera that sees less.
  if (clipped.size() < enough) clipped = clipped_by(std::array{0.0});
  out.calibration = calibrated(together(exact), clipped);
  return out;
}

}  // namespace lightrig
