#include "core/svd.h"

#include <Eigen/SVD>

namespace lightrig {

std::optional<Eigen::VectorXd> divide_and_conquer_singular_values(const Eigen::MatrixXd& G) {
  const Eigen::BDCSVD<Eigen::MatrixXd> svd(G);
  if (svd.info() != Eigen::Success || !svd.singularValues().allFinite()) return std::nullopt;
  return svd.singularValues();
}

RightSingular right_singular(const Eigen::MatrixXd& G) {
  const Eigen::BDCSVD<Eigen::MatrixXd> svd(G, Eigen::ComputeFullV);
  return {svd.singularValues(), svd.matrixV()};
}

}  // namespace lightrig
