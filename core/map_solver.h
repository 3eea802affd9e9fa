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

  /// The same with rows (fixed) that were factored before: their information is taken over, and
  /// solve_with() adds what they say.
  MapSolver(const MapSolver& fixed, const Eigen::MatrixXd& G, const Eigen::VectorXd& row_variance);
  /// Posterior mean (k) for the residuals y of the rows of this constructor, and y_fixed of those
  /// of `fixed`.
  Eigen::VectorXd solve_with(const MapSolver& fixed, const Eigen::VectorXd& y_fixed,
                             const Eigen::VectorXd& y) const;

  /// Posterior means (k × n) for residuals y − G·0 of (rows × n).
  Eigen::MatrixXd solve(const Eigen::MatrixXd& y) const;

  /// Posterior covariance (k × k).
  Eigen::MatrixXd covariance() const;

 private:
  void add_rows(const Eigen::MatrixXd& G, const Eigen::VectorXd& row_variance);
  Eigen::MatrixXd weighted_;  ///< (rows × k) W G S
  Eigen::MatrixXd normal_;    ///< (k × k) SGᵀWGS + I, lower half
  Eigen::VectorXd stddev_;
  Eigen::LLT<Eigen::MatrixXd> llt_;
};

}  // namespace lightrig
