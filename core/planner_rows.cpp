#include "core/planner_rows.h"

#include <Eigen/Cholesky>
#include <Eigen/QR>
#include <algorithm>
#include <cmath>
#include <functional>

#include "core/check.h"
#include "core/planner_kernels.h"
#include "core/svd.h"

namespace lightrig {

Eigen::MatrixXd CellRows::gather(std::span<const std::int32_t> cells) const {
  const int channels = per_cell();
  Eigen::MatrixXd G(static_cast<Eigen::Index>(cells.size()) * channels, components());
  Eigen::Index row = 0;
  for (const std::int32_t cell : cells) {
    for (int c = 0; c < channels; ++c) G.row(row++) = basis_.V.row(basis_.row(cell, c));
  }
  return G;
}

std::vector<std::int32_t> unseen(std::span<const std::int32_t> offered,
                                 const std::vector<std::uint8_t>& seen) {
  std::vector<std::int32_t> fresh;
  for (const std::int32_t cell : offered) {
    if (seen[static_cast<std::size_t>(cell)] == 0) fresh.push_back(cell);
  }
  return fresh;
}

std::vector<std::int32_t> marked(const std::vector<std::uint8_t>& seen) {
  std::vector<std::int32_t> cells;
  for (std::size_t c = 0; c < seen.size(); ++c) {
    if (seen[c] != 0) cells.push_back(static_cast<std::int32_t>(c));
  }
  return cells;
}

Eigen::VectorXd singular_values(const Eigen::MatrixXd& G) {
  if (G.rows() == 0 || G.cols() == 0) return Eigen::VectorXd();
  Eigen::MatrixXd R = G;
  if (G.rows() > G.cols()) {
    const Eigen::HouseholderQR<Eigen::MatrixXd> qr(G);
    R = qr.matrixQR().topRows(G.cols()).triangularView<Eigen::Upper>();
  }
  // Beyond a hundred columns the divide-and-conquer solver is quicker. It is known to fail on some
  // inputs; then, and below, rotations decide.
  if (std::min(R.rows(), R.cols()) > 96) {
    if (const auto singular = divide_and_conquer_singular_values(R)) return *singular;
  }
  // A pivoted QR first, then rotations of its transposed factor: that converges in few sweeps and
  // keeps small singular values to high relative accuracy [Drmač and Veselić 2008].
  const Eigen::ColPivHouseholderQR<Eigen::MatrixXd> pivoted(R);
  const Eigen::Index n = std::min(R.rows(), R.cols());
  const Eigen::Index stride = (R.cols() + 7) / 8 * 8;
  Eigen::MatrixXd columns = Eigen::MatrixXd::Zero(stride, n);
  columns.topRows(R.cols()) =
      pivoted.matrixQR().topRows(n).triangularView<Eigen::Upper>().transpose();
  orthogonalize_columns({columns.data(), static_cast<std::size_t>(columns.size())},
                        static_cast<int>(n), static_cast<int>(stride), 40, vector_level());
  Eigen::VectorXd singular = columns.colwise().norm();
  std::sort(singular.begin(), singular.end(), std::greater<>());
  return singular;
}

Conditioning conditioning_of(const Eigen::VectorXd& singular, Eigen::Index rows, Eigen::Index k) {
  Conditioning result;
  if (singular.size() == 0 || !(singular[0] > 0)) return result;
  const double least =
      static_cast<double>(std::max(rows, k)) * std::numeric_limits<double>::epsilon() * singular[0];
  for (const double sigma : singular) {
    if (sigma > least) ++result.rank;
  }
  const double ratio = singular[0] / singular[result.rank - 1];
  result.pseudo_condition = ratio * ratio;
  if (result.rank == k) result.condition = result.pseudo_condition;
  return result;
}

double posterior_trace(const Eigen::VectorXd& stddev, const Eigen::MatrixXd& G, double sigma) {
  CHECK(sigma > 0);
  // With W = G diag(s)/σ the posterior is diag(s) (I + WᵀW)⁻¹ diag(s): always positive definite,
  // and free of 1/s where a component has no spread.
  const Eigen::Index k = stddev.size();
  Eigen::MatrixXd A = Eigen::MatrixXd::Identity(k, k);
  if (G.rows() > 0) {
    const Eigen::MatrixXd W = (G * stddev.asDiagonal()) / sigma;
    A.noalias() += W.transpose() * W;
  }
  const Eigen::LLT<Eigen::MatrixXd> cholesky(A);
  CHECK(cholesky.info() == Eigen::Success);
  const Eigen::MatrixXd S = stddev.asDiagonal();
  return cholesky.matrixL().solve(S).squaredNorm();
}

double tie_tolerance(double score) {
  // Backward-stable singular values make a relative error of a few ε·κ in κ².
  return std::max(1e-9, 16 * std::numeric_limits<double>::epsilon() * std::sqrt(score));
}

Standing best_of(std::span<const Standing> standings) {
  Standing best;
  for (const Standing& s : standings) {
    if (s.candidate < 0) continue;
    if (best.candidate < 0 || s.rank > best.rank || (s.rank == best.rank && s.score < best.score)) {
      best = s;
    }
  }
  if (best.candidate < 0) return best;
  const double limit = best.score * (1 + tie_tolerance(best.score));
  Standing first = best;
  for (const Standing& s : standings) {
    if (s.candidate < 0 || s.rank != best.rank || s.score > limit) continue;
    if (s.candidate < first.candidate) first = s;
  }
  return first;
}

}  // namespace lightrig
