#pragma once

#include <Eigen/Cholesky>
#include <Eigen/Core>

namespace lightrig {

/// Gaussian posterior of y = G c + e, e ~ N(0, diag(row_variance)), c ~ N(0, diag(stddev²)):
/// factored once, then solved for any number of right sides. Works on z = c/stddev, whose normal
/// matrix SGᵀWGS + I has no eigenvalue below 1, so that no set of rows, however few or repeated,
/// is singular.
class MapSolver {
 public:
  /// G (rows × k), row_variance (rows) > 0, infinite for a row without information, stddev (k).
  MapSolver(const Eigen::MatrixXd& G, const Eigen::VectorXd& row_variance,
            const Eigen::VectorXd& stddev);

  /// Posterior means (k × n) for residuals y − G·0 of (rows × n).
  Eigen::MatrixXd solve(const Eigen::MatrixXd& y) const;

  /// Posterior covariance (k × k).
  Eigen::MatrixXd covariance() const;

 private:
  Eigen::MatrixXd weighted_;  ///< (rows × k) W G S
  Eigen::VectorXd stddev_;
  Eigen::LLT<Eigen::MatrixXd> llt_;
};

}  // namespace lightrig
