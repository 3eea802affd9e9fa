#include "core/row_factor.h"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cstddef>

namespace lightrig {

namespace {

/// κ² up to which the eigenvalues of a Gram matrix tell it to about 1e-12: their error is a few
/// ε·κ².
constexpr double plain_condition = 1e4;

/// The same of a whole matrix, of which the lower triangle counts.
std::optional<Conditioning> conditioning_of_matrix(const Eigen::MatrixXd& gram) {
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> eigen(gram, Eigen::EigenvaluesOnly);
  const Eigen::Index k = gram.rows();
  const double least = eigen.eigenvalues()[0], greatest = eigen.eigenvalues()[k - 1];
  if (eigen.info() != Eigen::Success || !(least > 0)) return std::nullopt;
  if (!(least * plain_condition >= greatest)) return std::nullopt;
  return Conditioning{greatest / least, greatest / least, static_cast<int>(k)};
}

}  // namespace

void extend_factor(const PackedRows& R, const PackedRows& rows, std::span<const std::int32_t> cells,
                   PackedRows& out, std::vector<double>& scratch, int level) {
  const int k = rows.k, stride = rows.stride;
  out.k = k;
  out.stride = stride;
  out.data.assign(R.data.begin(), R.data.end());
  for (const std::int32_t cell : cells) {
    const double* of_cell = rows.of(cell);
    out.data.insert(out.data.end(), of_cell,
                    of_cell + static_cast<std::ptrdiff_t>(rows.per_cell) * stride);
  }
  auto count = static_cast<int>(out.data.size() / static_cast<std::size_t>(stride));
  if (count > k) {
    scratch.resize(static_cast<std::size_t>(count + stride));
    triangularize(out.data, count, k, stride, scratch, level);
    out.data.resize(static_cast<std::size_t>(k) * static_cast<std::size_t>(stride));
    for (int i = 1; i < k; ++i) {
      double* row = out.data.data() + static_cast<std::ptrdiff_t>(i) * stride;
      std::fill(row, row + i, 0.0);
    }
    count = k;
  }
  out.per_cell = count;
}

std::optional<Conditioning> conditioning_of_gram(std::span<const double> gram, int k, int stride) {
  return conditioning_of_matrix(
      Eigen::Map<const Eigen::MatrixXd>(gram.data(), stride, k).topRows(k));
}

Conditioning conditioning_of_factor(const PackedRows& R, Eigen::Index rows) {
  const Eigen::Index k = R.k;
  const Eigen::Index count = static_cast<Eigen::Index>(R.data.size()) / R.stride;
  const Eigen::Map<const Eigen::MatrixXd> transposed(R.data.data(), R.stride, count);
  const Eigen::MatrixXd square = transposed.topRows(k).transpose();
  if (count == k) {
    if (const auto plain = conditioning_of_matrix(square.transpose() * square)) return *plain;
  }
  return conditioning_of(singular_values(square), rows, k);
}

FactorEnergies energies_of_factor(const PackedRows& R, std::span<const double> x,
                                  std::span<const double> y, int level) {
  FactorEnergies energies;
  if (R.data.empty()) return energies;
  const std::int32_t all = 0;
  cell_energies(R, {&all, 1}, x, y, {&energies.of_x, 1}, {&energies.of_y, 1}, level);
  return energies;
}

}  // namespace lightrig
