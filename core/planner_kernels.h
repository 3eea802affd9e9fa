#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <utility>
#include <vector>

namespace lightrig {

/// Memory that is not set to 0 before it is written: of megabytes, that would be a pass of its own.
template <class T>
struct Uninitialized : std::allocator<T> {
  template <class U>
  struct rebind {
    using other = Uninitialized<U>;
  };
  template <class U>
  void construct(U* at) {
    ::new (static_cast<void*>(at)) U;
  }
  template <class U, class... Arguments>
  void construct(U* at, Arguments&&... arguments) {
    ::new (static_cast<void*>(at)) U(std::forward<Arguments>(arguments)...);
  }
};

/// Rows of numbers padded with zeros to whole vectors of eight, cell by cell: the memory that the
/// planner's inner loops run over.
struct PackedRows {
  int k = 0;         ///< numbers in a row
  int stride = 0;    ///< k rounded up to a multiple of 8
  int per_cell = 1;  ///< rows of one cell, one after another
  std::vector<double, Uninitialized<double>> data;

  const double* of(std::int32_t cell) const {
    return data.data() + static_cast<std::int64_t>(cell) * per_cell * stride;
  }
};

/// The x86-64 level (2, 3 or 4) of this processor. The planner's arithmetic is compiled for each
/// and picked at run time; all add in one order of eight partial sums, and differ by the rounding
/// that fused multiply-adds leave out.
int vector_level();

/// Upper triangle of A (k × stride, row-major) += sign · Σ g gᵀ over the rows of these cells. What
/// lies below the diagonal within its vector of eight is filled too, the rest is not. A may be of
/// the rows' first numbers alone: (head × head), head a multiple of eight.
void add_gram(const PackedRows& rows, std::span<const std::int32_t> cells, std::span<double> A,
              int level, double sign = 1);
void add_head_gram(const PackedRows& rows, std::span<const std::int32_t> cells, int head,
                   std::span<double> A, int level);

/// Σ (g·x)² and Σ (g·y)² over the rows of one cell, for each of these cells. x and y have `stride`
/// numbers, zeros at the end.
void cell_energies(const PackedRows& rows, std::span<const std::int32_t> cells,
                   std::span<const double> x, std::span<const double> y, std::span<double> of_x,
                   std::span<double> of_y, int level);

/// The upper triangular factor of a matrix of `count` rows of `stride` numbers, k of them its
/// columns, in place of its first min(count, k) rows, by Householder reflections. What it leaves
/// below the diagonal is of no meaning. `scratch` has count + stride numbers.
void triangularize(std::span<double> rows, int count, int k, int stride, std::span<double> scratch,
                   int level);

/// Turns the columns of a matrix (`count` columns of `stride` numbers, one after another) by plane
/// rotations until each pair is orthogonal to working precision: one-sided Jacobi [Hestenes 1958].
/// Their lengths are then the singular values. Returns the sweeps taken, at most `limit`.
int orthogonalize_columns(std::span<double> columns, int count, int stride, int limit, int level);

}  // namespace lightrig
