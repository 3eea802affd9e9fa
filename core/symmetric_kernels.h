#pragma once

#include <cstdint>
#include <span>

#include "core/planner_kernels.h"

namespace lightrig {

/// The arithmetic of symmetric matrices, compiled for each level of processor as in
/// planner_kernels.h. Symmetric matrices are their upper triangles, row by row, `stride` numbers
/// (a multiple of eight, zeros or anything beyond the k-th) to a row.

/// The numbers from one vector of eight to the next that hold k.
constexpr int padded(int k) { return (k + 7) / 8 * 8; }

/// Each cell's rows times T (k × stride), into the same cells of `out`, which has the layout of
/// `rows`.
void transform_rows(const PackedRows& rows, std::span<const std::int32_t> cells,
                    std::span<const double> T, std::span<double> out, int level);

/// Sum of squares of each number from the first-th on, over the rows of these cells. `first` is a
/// multiple of eight; (stride − first).
void column_energies(const PackedRows& rows, std::span<const std::int32_t> cells, int first,
                     std::span<double> energy, int level);

/// A = RᵀR in place: R is upper triangular, zero below the diagonal within its vector of eight.
/// False where A is not positive definite.
bool cholesky(std::span<double> A, int k, int stride, int level);

/// A⁻¹x from A's factor R, and Ax from A's upper triangle, in place; x has `stride` numbers, zeros
/// at the end.
void solve_with_factor(std::span<const double> R, int k, int stride, std::span<double> x,
                       int level);
void multiply(std::span<const double> A, int k, int stride, std::span<const double> x,
              std::span<double> product, int level);

/// The inverse of Rᵀ, lower triangular, (k × stride) with zeros above the diagonal.
void invert_factor(std::span<const double> R, int k, int stride, std::span<double> inverse,
                   int level);

/// Σ weight_i (A⁻¹)_ii from A's factor R; weight has `stride` numbers, zeros at the end. `inverse`
/// becomes what invert_factor() gives.
double trace_of_inverse(std::span<const double> R, int k, int stride,
                        std::span<const double> weight, std::span<double> inverse, int level);

}  // namespace lightrig
