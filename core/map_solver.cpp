#include "core/map_solver.h"

#include "core/check.h"

namespace lightrig {

MapSolver::MapSolver(const Eigen::MatrixXd& G, const Eigen::VectorXd& row_variance,
                     const Eigen::VectorXd& stddev)
    : normal_(Eigen::MatrixXd::Identity(stddev.size(), stddev.size())), stddev_(stddev) {
  add_rows(G, row_variance);
}

MapSolver::MapSolver(const MapSolver& fixed, const Eigen::MatrixXd& G,
                     const Eigen::VectorXd& row_variance)
    : normal_(fixed.normal_), stddev_(fixed.stddev_) {
  add_rows(G, row_variance);
}

void MapSolver::add_rows(const Eigen::MatrixXd& G, const Eigen::VectorXd& row_variance) {
  CHECK(G.rows() == row_variance.size() && G.cols() == stddev_.size());
  CHECK(row_variance.size() == 0 || row_variance.minCoeff() > 0);
  const Eigen::VectorXd root_weight = row_variance.cwiseSqrt().cwiseInverse();
  const Eigen::MatrixXd A = root_weight.asDiagonal() * G * stddev_.asDiagonal();
  weighted_ = root_weight.asDiagonal() * A;
  // Eigen 3.4.0's rankUpdate divides by zero on an empty matrix.
  if (A.rows() > 0) normal_.selfadjointView<Eigen::Lower>().rankUpdate(A.transpose());
  llt_.compute(normal_);
  CHECK(llt_.info() == Eigen::Success);
}

Eigen::MatrixXd MapSolver::solve(const Eigen::MatrixXd& y) const {
  CHECK(y.rows() == weighted_.rows());
  return stddev_.asDiagonal() * llt_.solve(weighted_.transpose() * y);
}

Eigen::VectorXd MapSolver::solve_with(const MapSolver& fixed, const Eigen::VectorXd& y_fixed,
                                      const Eigen::VectorXd& y) const {
  CHECK(y.size() == weighted_.rows() && y_fixed.size() == fixed.weighted_.rows());
  const Eigen::VectorXd right = weighted_.transpose() * y + fixed.weighted_.transpose() * y_fixed;
  return stddev_.asDiagonal() * llt_.solve(right);
}

Eigen::MatrixXd MapSolver::covariance() const {
  const Eigen::Index k = stddev_.size();
  Eigen::MatrixXd half = llt_.matrixL().solve(Eigen::MatrixXd::Identity(k, k));
  half = half * stddev_.asDiagonal();
  return half.transpose() * half;
}

}  // namespace lightrig
