#pragma once

#include <Eigen/Core>
#include <vector>

#include "core/brdf_basis.h"

namespace lightrig {

/// Training columns of a basis and what is known of them.
struct Training {
  Eigen::MatrixXd X;     ///< (rows × n) mapped values, mean removed; 0 in invalid cells
  Eigen::VectorXd mean;  ///< (rows)
  Eigen::VectorXd y_min, y_max;
  std::vector<int> material_of;  ///< (n)
  std::vector<int>
      group_of;  ///< (n): what is left out together: a family, or a material where none is known
  int groups = 0;
};

/// Eigenvectors of a Gram matrix, largest first, as many as rise above rounding.
struct GramSpectrum {
  Eigen::VectorXd lambda;
  Eigen::MatrixXd U;
};
GramSpectrum spectrum(const Eigen::MatrixXd& K, Eigen::Index rows);

/// What leaving materials out says of a basis: how it serves materials it has not seen.
struct LeaveOut {
  Eigen::VectorXd stddev;   ///< (k) of the coefficients of unseen materials, descending
  double model_sigma = 0;   ///< mapped units: of a row in a fit
  double unsaid_sigma = 0;  ///< mapped units: rms of what no coefficients can say
  ErrorCalibration calibration;
  bool any = false;  ///< false: too few materials to leave any out
  /// Of a row's training range, what it has to be wider by on either side so that no fold's range
  /// cuts a material that was left out of it; at most 1.
  double range_slack = 0.5;
};

/// Folds over groups, a family never torn apart: a material whose siblings are in the basis is no
/// unseen one. K = XᵀX. Everything is inner products of columns and the few rows that a handful of
/// lights would show, so a fold costs one eigenproblem of its columns. `k` components are kept.
/// Fewer than three columns inside some fold, or none outside: nothing can be left out, and what no
/// coefficients can say is taken to be as large as the training set's scatter about its mean, with
/// twice the usual spread.
LeaveOut leave_materials_out(const BrdfBasis& basis, const Training& training,
                             const Eigen::MatrixXd& K, int folds, int threads);

}  // namespace lightrig
