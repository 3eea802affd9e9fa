#pragma once

#include <cstddef>
#include <span>

namespace lightrig {

/// Eight symmetric matrices side by side, one per lane of a vector: what is done to one is done to
/// all eight at the cost of one. Numbers lie lane by lane: element (i, j ≤ i) of the lower triangle
/// is the batch_index(i, j)-th vector of eight, element i of a vector of unknowns the i-th.
inline constexpr int batch_size = 8;

constexpr std::size_t batch_index(int i, int j) {
  return static_cast<std::size_t>(i) * static_cast<std::size_t>(i + 1) / 2 +
         static_cast<std::size_t>(j);
}
/// Numbers of eight k × k matrices, and of eight vectors of k.
constexpr std::size_t batch_matrix_size(int k) { return batch_size * batch_index(k, 0); }
constexpr std::size_t batch_vector_size(int k) { return batch_size * static_cast<std::size_t>(k); }

/// A = L D Lᵀ in place, L without its unit diagonal, and 1/D in `inverse_diagonal`. A lane that is
/// not positive definite ends with a pivot that is not positive, or not a number; others are not
/// touched by it.
void batch_factor(std::span<double> A, int k, std::span<double> inverse_diagonal, int level);

/// A⁻¹x in place, from the factor.
void batch_solve(std::span<const double> factor, int k, std::span<const double> inverse_diagonal,
                 std::span<double> x, int level);

/// product = Ax.
void batch_multiply(std::span<const double> A, int k, std::span<const double> x,
                    std::span<double> product, int level);

/// Each lane times its own factor; (8) factors.
void batch_scale(std::span<double> x, std::span<const double> factors, int level);

/// Σ x_i y_i of each lane; (8).
void batch_dot(std::span<const double> x, std::span<const double> y, std::span<double> sums,
               int level);

}  // namespace lightrig
