#pragma once

#include <Eigen/Core>
#include <optional>

namespace lightrig {

/// Eigen's divide-and-conquer SVD behind two plain functions: its template takes a compiler ten
/// seconds wherever it is instantiated, so it is instantiated once, in svd.cpp.

/// The singular values of G (m × n), largest first (min(m, n)); none where the solver gave up.
std::optional<Eigen::VectorXd> divide_and_conquer_singular_values(const Eigen::MatrixXd& G);

/// G = U diag(values) Vᵀ, without U.
struct RightSingular {
  Eigen::VectorXd values;  ///< (min(m, n)), largest first
  Eigen::MatrixXd V;       ///< (n × n); columns beyond the values span what G does not see
};
RightSingular right_singular(const Eigen::MatrixXd& G);

}  // namespace lightrig
