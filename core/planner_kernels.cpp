#include "core/planner_kernels.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>

#include "core/check.h"
#include "core/lanes.h"

// One body per loop, inlined into one function per instruction set. The vectors of eight are the
// compiler's own: they become one, two or four registers, and every variant adds in one order.

namespace lightrig {

namespace {

constexpr int width = lane_width;

[[gnu::always_inline]] inline const Lanes& at(const double* p) { return lanes_at(p); }
[[gnu::always_inline]] inline Lanes& at(double* p) { return lanes_at(p); }

/// A (k × columns) += Σ g gᵀ over six rows at a time, a vector of columns j ≥ i held while they
/// pass.
[[gnu::always_inline]] inline void gram_body(const PackedRows& rows,
                                             std::span<const std::int32_t> cells, double sign,
                                             int k, int columns, double* A) {
  const int stride = rows.stride;
  constexpr std::size_t together = 6;
  const double* g[together];
  const std::size_t total = cells.size() * static_cast<std::size_t>(rows.per_cell);
  std::size_t taken = 0, cell = 0;
  int part = 0;
  while (taken < total) {
    std::size_t n = 0;
    for (; n < together && taken < total; ++n, ++taken) {
      g[n] = rows.of(cells[cell]) + static_cast<std::ptrdiff_t>(part) * stride;
      if (++part == rows.per_cell) {
        part = 0;
        ++cell;
      }
    }
    if (n < together) {
      for (int i = 0; i < k; ++i) {
        for (std::size_t r = 0; r < n; ++r) {
          const double factor = sign * g[r][i];
          for (int j = i - i % width; j < columns; j += width) {
            at(A + i * columns + j) += factor * at(g[r] + j);
          }
        }
      }
      break;
    }
    for (int i = 0; i < k; ++i) {
      const double f0 = sign * g[0][i], f1 = sign * g[1][i], f2 = sign * g[2][i],
                   f3 = sign * g[3][i], f4 = sign * g[4][i], f5 = sign * g[5][i];
      for (int j = i - i % width; j < columns; j += width) {
        Lanes a = at(A + i * columns + j);
        a += f0 * at(g[0] + j);
        a += f1 * at(g[1] + j);
        a += f2 * at(g[2] + j);
        a += f3 * at(g[3] + j);
        a += f4 * at(g[4] + j);
        a += f5 * at(g[5] + j);
        at(A + i * columns + j) = a;
      }
    }
  }
}

/// The eight sums of eight vectors.
[[gnu::always_inline]] inline void sums_of(const Lanes& a, const Lanes& b, const Lanes& c,
                                           const Lanes& d, const Lanes& e, const Lanes& f,
                                           const Lanes& g, const Lanes& h, double* sums) {
  const Lanes ab = __builtin_shufflevector(a, b, 0, 8, 2, 10, 4, 12, 6, 14) +
                   __builtin_shufflevector(a, b, 1, 9, 3, 11, 5, 13, 7, 15);
  const Lanes cd = __builtin_shufflevector(c, d, 0, 8, 2, 10, 4, 12, 6, 14) +
                   __builtin_shufflevector(c, d, 1, 9, 3, 11, 5, 13, 7, 15);
  const Lanes ef = __builtin_shufflevector(e, f, 0, 8, 2, 10, 4, 12, 6, 14) +
                   __builtin_shufflevector(e, f, 1, 9, 3, 11, 5, 13, 7, 15);
  const Lanes gh = __builtin_shufflevector(g, h, 0, 8, 2, 10, 4, 12, 6, 14) +
                   __builtin_shufflevector(g, h, 1, 9, 3, 11, 5, 13, 7, 15);
  const Lanes abcd = __builtin_shufflevector(ab, cd, 0, 1, 8, 9, 4, 5, 12, 13) +
                     __builtin_shufflevector(ab, cd, 2, 3, 10, 11, 6, 7, 14, 15);
  const Lanes efgh = __builtin_shufflevector(ef, gh, 0, 1, 8, 9, 4, 5, 12, 13) +
                     __builtin_shufflevector(ef, gh, 2, 3, 10, 11, 6, 7, 14, 15);
  lanes_at(sums) = __builtin_shufflevector(abcd, efgh, 0, 1, 2, 3, 8, 9, 10, 11) +
                   __builtin_shufflevector(abcd, efgh, 4, 5, 6, 7, 12, 13, 14, 15);
}

/// Four rows at a time, each along x and along y.
[[gnu::always_inline]] inline void energy_body(const PackedRows& rows,
                                               std::span<const std::int32_t> cells, const double* x,
                                               const double* y, double* of_x, double* of_y) {
  constexpr int together = 4;
  const int stride = rows.stride;
  std::size_t cell = 0;
  int part = 0;
  for (std::size_t c = 0; c < cells.size(); ++c) of_x[c] = of_y[c] = 0;
  while (cell < cells.size()) {
    const double* g[together];
    std::size_t of[together];
    int n = 0;
    for (; n < together && cell < cells.size(); ++n) {
      g[n] = rows.of(cells[cell]) + static_cast<std::ptrdiff_t>(part) * stride;
      of[n] = cell;
      if (++part == rows.per_cell) {
        part = 0;
        ++cell;
      }
    }
    for (int r = n; r < together; ++r) g[r] = g[0];  // what they give is not looked at
    Lanes x0{}, x1{}, x2{}, x3{}, y0{}, y1{}, y2{}, y3{};
    for (int j = 0; j < stride; j += width) {
      const Lanes vx = at(x + j), vy = at(y + j);
      const Lanes g0 = at(g[0] + j), g1 = at(g[1] + j), g2 = at(g[2] + j), g3 = at(g[3] + j);
      x0 += g0 * vx;
      y0 += g0 * vy;
      x1 += g1 * vx;
      y1 += g1 * vy;
      x2 += g2 * vx;
      y2 += g2 * vy;
      x3 += g3 * vx;
      y3 += g3 * vy;
    }
    double along[width];
    sums_of(x0, x1, x2, x3, y0, y1, y2, y3, along);
    for (int r = 0; r < n; ++r) {
      of_x[of[r]] += along[r] * along[r];
      of_y[of[r]] += along[r + together] * along[r + together];
    }
  }
}

[[gnu::always_inline]] inline void triangularize_body(double* A, int count, int k, int stride,
                                                      double* v, double* w) {
  for (int p = 0; p < std::min(count - 1, k); ++p) {
    double below = 0;
    for (int i = p + 1; i < count; ++i) {
      v[i] = A[i * stride + p];
      below += v[i] * v[i];
    }
    if (!(below > 0)) continue;
    const double pivot = A[p * stride + p];
    const double beta = -std::copysign(std::sqrt(pivot * pivot + below), pivot);
    const double tau = (beta - pivot) / beta;
    const double scale = 1 / (pivot - beta);
    const int from = p - p % width;
    for (int j = from; j < stride; j += width) at(w + j) = at(A + p * stride + j);
    for (int i = p + 1; i < count; ++i) {
      v[i] *= scale;
      for (int j = from; j < stride; j += width) at(w + j) += v[i] * at(A + i * stride + j);
    }
    for (int j = from; j < stride; j += width) at(A + p * stride + j) -= tau * at(w + j);
    for (int i = p + 1; i < count; ++i) {
      const double factor = tau * v[i];
      for (int j = from; j < stride; j += width) at(A + i * stride + j) -= factor * at(w + j);
    }
    A[p * stride + p] = beta;
  }
}

[[gnu::always_inline]] inline int jacobi_body(double* columns, int count, int stride, int limit) {
  const double small = 16 * std::numeric_limits<double>::epsilon();
  for (int sweep = 1; sweep <= limit; ++sweep) {
    bool turned = false;
    for (int p = 0; p < count - 1; ++p) {
      double* a = columns + static_cast<std::ptrdiff_t>(p) * stride;
      for (int q = p + 1; q < count; ++q) {
        double* b = columns + static_cast<std::ptrdiff_t>(q) * stride;
        Lanes sum_aa{}, sum_bb{}, sum_ab{};
        for (int j = 0; j < stride; j += width) {
          const Lanes x = at(a + j), y = at(b + j);
          sum_aa += x * x;
          sum_bb += y * y;
          sum_ab += x * y;
        }
        const Lanes none{};
        double sums[width];
        sums_of(sum_aa, sum_bb, sum_ab, none, none, none, none, none, sums);
        const double aa = sums[0], bb = sums[1], ab = sums[2];
        if (!(std::abs(ab) > small * std::sqrt(aa) * std::sqrt(bb))) continue;
        turned = true;
        const double zeta = (bb - aa) / (2 * ab);
        const double t = std::copysign(1.0, zeta) / (std::abs(zeta) + std::sqrt(1 + zeta * zeta));
        const double c = 1 / std::sqrt(1 + t * t), s = c * t;
        for (int j = 0; j < stride; j += width) {
          const Lanes x = at(a + j), y = at(b + j);
          at(a + j) = c * x - s * y;
          at(b + j) = s * x + c * y;
        }
      }
    }
    if (!turned) return sweep;
  }
  return limit;
}

}  // namespace

int vector_level() {
#if defined(__x86_64__)
  if (__builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512dq") &&
      __builtin_cpu_supports("avx512vl") && __builtin_cpu_supports("avx512bw")) {
    return 4;
  }
  if (__builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma") &&
      __builtin_cpu_supports("bmi2")) {
    return 3;
  }
#endif
  return 2;
}

void add_gram(const PackedRows& rows, std::span<const std::int32_t> cells, std::span<double> A,
              int level, double sign) {
  CHECK(A.size() == static_cast<std::size_t>(rows.k) * static_cast<std::size_t>(rows.stride));
  on_level(
      level, [&]() __attribute__((always_inline)) {
        gram_body(rows, cells, sign, rows.k, rows.stride, A.data());
      });
}

void add_head_gram(const PackedRows& rows, std::span<const std::int32_t> cells, int head,
                   std::span<double> A, int level) {
  CHECK(head % width == 0 && head <= rows.stride);
  CHECK(A.size() == static_cast<std::size_t>(head) * static_cast<std::size_t>(head));
  on_level(
      level, [&]() __attribute__((always_inline)) {
        gram_body(rows, cells, 1.0, head, head, A.data());
      });
}

void cell_energies(const PackedRows& rows, std::span<const std::int32_t> cells,
                   std::span<const double> x, std::span<const double> y, std::span<double> of_x,
                   std::span<double> of_y, int level) {
  CHECK(x.size() == static_cast<std::size_t>(rows.stride) && y.size() == x.size());
  CHECK(of_x.size() == cells.size() && of_y.size() == cells.size());
  on_level(
      level, [&]() __attribute__((always_inline)) {
        energy_body(rows, cells, x.data(), y.data(), of_x.data(), of_y.data());
      });
}

void triangularize(std::span<double> rows, int count, int k, int stride, std::span<double> scratch,
                   int level) {
  CHECK(rows.size() == static_cast<std::size_t>(count) * static_cast<std::size_t>(stride));
  CHECK(scratch.size() >= static_cast<std::size_t>(count + stride));
  on_level(
      level, [&]() __attribute__((always_inline)) {
        triangularize_body(rows.data(), count, k, stride, scratch.data() + stride, scratch.data());
      });
}

int orthogonalize_columns(std::span<double> columns, int count, int stride, int limit, int level) {
  CHECK(columns.size() == static_cast<std::size_t>(count) * static_cast<std::size_t>(stride));
  return on_level(
      level, [&]() __attribute__((always_inline)) {
        return jacobi_body(columns.data(), count, stride, limit);
      });
}

}  // namespace lightrig
