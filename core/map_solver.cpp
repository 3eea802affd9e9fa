#include "core/map_solver.h"

#include "core/check.h"

namespace lightrig {

MapSolver::MapSolver(const Eigen::MatrixXd& G, const Eigen::VectorXd& row_variance,
                     const Eigen::VectorXd& stddev)
    : stddev_(stddev) {
  CHECK(G.rows() == row_variance.size() && G.cols() == stddev.size());
  CHECK(row_variance.size() == 0 || row_variance.minCoeff() > 0);
  const Eigen::VectorXd root_weight = row_variance.cwiseSqrt().cwiseInverse();
  const Eigen::MatrixXd A = root_weight.asDiagonal() * G * stddev.asDiagonal();
  weighted_ = root_weight.asDiagonal() * A;
  Eigen::MatrixXd normal = Eigen::MatrixXd::Identity(G.cols(), G.cols());
  // Eigen 3.4.0's rankUpdate divides by zero on an empty matrix.
  if (A.rows() > 0) normal.selfadjointView<Eigen::Lower>().rankUpdate(A.transpose());
  llt_.compute(normal);
  CHECK(llt_.info() == Eigen::Success);
}

Eigen::MatrixXd MapSolver::solve(const Eigen::MatrixXd& y) const {
  CHECK(y.rows() == weighted_.rows());
  return stddev_.asDiagonal() * llt_.solve(weighted_.transpose() * y);
}

Eigen::MatrixXd MapSolver::covariance() const {
  const Eigen::Index k = stddev_.size();
  Eigen::MatrixXd half = llt_.matrixL().solve(Eigen::MatrixXd::Identity(k, k));
  half = half * stddev_.asDiagonal();
  return half.transpose() * half;
}

}  // namespace lightrig
