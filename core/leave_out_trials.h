#pragma once

#include <Eigen/Core>
#include <span>
#include <vector>

#include "core/basis_training.h"

namespace lightrig {

/// One fold: the basis of the materials that stay, and the held-out ones in its coordinates.
struct Fold {
  std::vector<Eigen::Index> in, out;  ///< columns
  GramSpectrum spectrum;              ///< (k)
  Eigen::MatrixXd c;                  ///< (k × out) true coefficients of the held-out columns
  Eigen::VectorXd residual2;          ///< (out) squared norm of what no coefficient can say
};

/// MAP of the held-out columns for any sigma at the cost of one eigenproblem: with B = G S² Gᵀ =
/// Q D Qᵀ the estimate is S² Gᵀ Q (D + σ²)⁻¹ Qᵀ y.
class FoldFits {
 public:
  /// `rows` of the basis are what the fits see; stddev (k) of the fold's coefficients.
  FoldFits(const Fold& fold, const Training& training, const std::vector<Eigen::Index>& rows,
           const Eigen::VectorXd& stddev);

  /// Standardised coefficients z = c/s of every held-out column, (k × out).
  Eigen::MatrixXd estimate(double row_variance) const;
  /// (k) Diagonal of the posterior covariance of z.
  Eigen::VectorXd variance(double row_variance) const;

  const Fold& fold() const { return fold_; }
  const Eigen::VectorXd& stddev() const { return stddev_; }
  const Eigen::MatrixXd& GS() const { return GS_; }  ///< (rows × k)
  const Eigen::MatrixXd& y() const { return y_; }    ///< (rows × out), the fold's mean taken off
  const Eigen::VectorXd& mean() const {
    return mean_;
  }  ///< (rows) of the fold, about training.mean

 private:
  const Fold& fold_;
  Eigen::VectorXd stddev_, mean_;
  Eigen::MatrixXd GS_, QtGS_, Qty_, y_;
  Eigen::VectorXd d_;
};

/// One simulated fit of a held-out material.
struct Trial {
  double ln_ratio = 0;  ///< ln(true error / expected error), norms over grid and channels
  double surprise = 0;  ///< ½ ln(‖c/s‖² / its expectation)
  double censored = 0;  ///< [0, 1] share of rows
};

/// One trial per material of the fold from its exact rows, channels together; unsaid2 is the mean
/// squared norm of what no coefficients can say.
std::vector<Trial> trials(const FoldFits& fits, const Training& training, double row_variance,
                          double unsaid2);

/// The same from clipped rows, as a bracket that spans `range` about a material's median row has
/// them: what is darker or brighter is known to be beyond a level and no more. How many rows that
/// are depends on the material, as it will; range 0: a tenth of every material's. Every row stands
/// for `step` alike. Materials without a clipped row yield none.
std::vector<Trial> clipped_trials(const BrdfBasis& basis, const FoldFits& fits,
                                  const Training& training, const std::vector<Eigen::Index>& rows,
                                  double sigma, int step, double unsaid2, double range);

/// Least squares of ln_ratio on surprise and, from the clipped trials, on the share censored; the
/// bands are quantiles of what remains, and deviations where trials are too few to tell any.
ErrorCalibration calibrated(std::span<const Trial> exact, std::span<const Trial> clipped);

}  // namespace lightrig
