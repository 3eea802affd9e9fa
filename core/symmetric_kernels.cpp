#include "core/symmetric_kernels.h"

#include <algorithm>
#include <cmath>
#include <cstddef>

#include "core/check.h"
#include "core/lanes.h"

namespace lightrig {

namespace {

constexpr int width = lane_width;

/// Rows looked at together: their sums stay in registers.
constexpr int rows_together = 4;

[[gnu::always_inline]] inline void transform_body(const double* const* in, double* const* out,
                                                  int k, int stride, const double* T) {
  int j = 0;
  for (; j + 2 * width <= stride; j += 2 * width) {
    Lanes a0{}, a1{}, b0{}, b1{}, c0{}, c1{}, d0{}, d1{};
    for (int i = 0; i < k; ++i) {
      const Lanes t0 = lanes_at(T + i * stride + j), t1 = lanes_at(T + i * stride + j + width);
      a0 += in[0][i] * t0;
      a1 += in[0][i] * t1;
      b0 += in[1][i] * t0;
      b1 += in[1][i] * t1;
      c0 += in[2][i] * t0;
      c1 += in[2][i] * t1;
      d0 += in[3][i] * t0;
      d1 += in[3][i] * t1;
    }
    lanes_at(out[0] + j) = a0;
    lanes_at(out[0] + j + width) = a1;
    lanes_at(out[1] + j) = b0;
    lanes_at(out[1] + j + width) = b1;
    lanes_at(out[2] + j) = c0;
    lanes_at(out[2] + j + width) = c1;
    lanes_at(out[3] + j) = d0;
    lanes_at(out[3] + j + width) = d1;
  }
  for (; j < stride; j += width) {
    Lanes a{}, b{}, c{}, d{};
    for (int i = 0; i < k; ++i) {
      const Lanes t = lanes_at(T + i * stride + j);
      a += in[0][i] * t;
      b += in[1][i] * t;
      c += in[2][i] * t;
      d += in[3][i] * t;
    }
    lanes_at(out[0] + j) = a;
    lanes_at(out[1] + j) = b;
    lanes_at(out[2] + j) = c;
    lanes_at(out[3] + j) = d;
  }
}

[[gnu::always_inline]] inline void energies_body(const PackedRows& rows,
                                                 std::span<const std::int32_t> cells, int first,
                                                 double* energy) {
  const int stride = rows.stride;
  int j = first;
  for (; j + 4 * width <= stride; j += 4 * width) {
    Lanes sum0{}, sum1{}, sum2{}, sum3{};
    for (const std::int32_t cell : cells) {
      const double* g = rows.of(cell) + j;
      for (int part = 0; part < rows.per_cell; ++part, g += stride) {
        sum0 += lanes_at(g) * lanes_at(g);
        sum1 += lanes_at(g + width) * lanes_at(g + width);
        sum2 += lanes_at(g + 2 * width) * lanes_at(g + 2 * width);
        sum3 += lanes_at(g + 3 * width) * lanes_at(g + 3 * width);
      }
    }
    double* to = energy + j - first;
    lanes_at(to) = sum0;
    lanes_at(to + width) = sum1;
    lanes_at(to + 2 * width) = sum2;
    lanes_at(to + 3 * width) = sum3;
  }
  for (; j < stride; j += width) {
    Lanes sum{};
    for (const std::int32_t cell : cells) {
      const double* g = rows.of(cell) + j;
      for (int part = 0; part < rows.per_cell; ++part, g += stride) {
        sum += lanes_at(g) * lanes_at(g);
      }
    }
    lanes_at(energy + j - first) = sum;
  }
}

/// Panels of four rows: each is finished by those above it in its panel, then the whole panel is
/// taken from all rows below at once.
[[gnu::always_inline]] inline bool cholesky_body(double* A, int k, int stride) {
  for (int p = 0; p < k; p += rows_together) {
    const int end = std::min(k, p + rows_together);
    for (int i = p; i < end; ++i) {
      double* row = A + static_cast<std::ptrdiff_t>(i) * stride;
      const int from = i - i % width;
      for (int q = p; q < i; ++q) {
        const double* above = A + static_cast<std::ptrdiff_t>(q) * stride;
        const double factor = above[i];
        for (int j = from; j < stride; j += width) {
          lanes_at(row + j) -= factor * lanes_at(above + j);
        }
      }
      const double pivot = row[i];
      if (!(pivot > 0) || !std::isfinite(pivot)) return false;
      const double scale = 1 / std::sqrt(pivot);
      for (int j = from; j < stride; j += width) lanes_at(row + j) *= scale;
      for (int c = from; c < i; ++c) row[c] = 0;
    }
    if (end == k) break;
    const double* r0 = A + static_cast<std::ptrdiff_t>(p) * stride;
    const double *r1 = r0 + stride, *r2 = r1 + stride, *r3 = r2 + stride;
    for (int i = end; i < k; ++i) {
      double* row = A + static_cast<std::ptrdiff_t>(i) * stride;
      const double f0 = r0[i], f1 = r1[i], f2 = r2[i], f3 = r3[i];
      for (int j = i - i % width; j < stride; j += width) {
        Lanes a = lanes_at(row + j);
        a -= f0 * lanes_at(r0 + j);
        a -= f1 * lanes_at(r1 + j);
        a -= f2 * lanes_at(r2 + j);
        a -= f3 * lanes_at(r3 + j);
        lanes_at(row + j) = a;
      }
    }
  }
  return true;
}

/// Forward and back substitution by blocks of eight: a block's own triangle in scalars, what it
/// means for the others in whole vectors.
[[gnu::always_inline]] inline void solve_body(const double* R, int k, int stride, double* x) {
  for (int first = 0; first < k; first += width) {
    const int block = std::min(width, k - first);
    double z[width] = {};
    for (int i = 0; i < block; ++i) {
      double sum = x[first + i];
      for (int q = 0; q < i; ++q) sum -= R[(first + q) * stride + first + i] * z[q];
      z[i] = sum / R[(first + i) * stride + first + i];
    }
    for (int i = 0; i < block; ++i) x[first + i] = z[i];
    for (int j = first + width; j < stride; j += width) {
      Lanes rest = lanes_at(x + j);
      for (int i = 0; i < block; ++i) rest -= z[i] * lanes_at(R + (first + i) * stride + j);
      lanes_at(x + j) = rest;
    }
  }
  for (int first = (k - 1) - (k - 1) % width; first >= 0; first -= width) {
    const int block = std::min(width, k - first);
    double z[width] = {};
    for (int i = 0; i < block; ++i) {
      Lanes sum{};
      for (int j = first + width; j < stride; j += width) {
        sum += lanes_at(R + (first + i) * stride + j) * lanes_at(x + j);
      }
      z[i] = x[first + i] - sum_of(sum);
    }
    for (int i = block - 1; i >= 0; --i) {
      for (int q = i + 1; q < block; ++q) z[i] -= R[(first + i) * stride + first + q] * z[q];
      z[i] /= R[(first + i) * stride + first + i];
    }
    for (int i = 0; i < block; ++i) x[first + i] = z[i];
  }
}

/// y = Ax, each row of the upper triangle used as a row and as a column.
[[gnu::always_inline]] inline void multiply_body(const double* A, int k, int stride,
                                                 const double* x, double* y) {
  for (int j = 0; j < stride; j += width) lanes_at(y + j) = Lanes{};
  for (int i = 0; i < k; ++i) {
    const double* row = A + static_cast<std::ptrdiff_t>(i) * stride;
    const int next = padded(i + 1);
    double own = row[i] * x[i];
    for (int c = i + 1; c < std::min(next, k); ++c) {
      own += row[c] * x[c];
      y[c] += row[c] * x[i];
    }
    Lanes sum{};
    for (int j = next; j < stride; j += width) {
      const Lanes a = lanes_at(row + j);
      sum += a * lanes_at(x + j);
      lanes_at(y + j) += x[i] * a;
    }
    y[i] += own + sum_of(sum);
  }
  for (int i = k; i < stride; ++i) y[i] = 0;
}

/// Eight rows of X = R⁻ᵀ at a time, by vectors of eight columns: first all that the rows above
/// contribute, then the block's own.
[[gnu::always_inline]] inline void invert_body(const double* R, int k, int stride, double* X) {
  for (int first = 0; first < k; first += width) {
    const int block = std::min(width, k - first);
    for (int c = 0; c < stride; c += width) {
      if (c > first) {
        for (int r = 0; r < block; ++r) lanes_at(X + (first + r) * stride + c) = Lanes{};
        continue;
      }
      Lanes x[width] = {};
      for (int i = c; i < first; ++i) {
        const Lanes above = lanes_at(X + i * stride + c);
        const double* f = R + i * stride + first;
        x[0] -= f[0] * above;
        x[1] -= f[1] * above;
        x[2] -= f[2] * above;
        x[3] -= f[3] * above;
        x[4] -= f[4] * above;
        x[5] -= f[5] * above;
        x[6] -= f[6] * above;
        x[7] -= f[7] * above;
      }
      for (int r = 0; r < block; ++r) {
        if (c == first) x[r][r] += 1.0;
        for (int q = 0; q < r; ++q) x[r] -= R[(first + q) * stride + first + r] * x[q];
        x[r] *= 1 / R[(first + r) * stride + first + r];
        lanes_at(X + (first + r) * stride + c) = x[r];
      }
    }
  }
}

[[gnu::always_inline]] inline double trace_body(const double* R, int k, int stride,
                                                const double* weight, double* X) {
  invert_body(R, k, stride, X);
  Lanes total{};
  for (int i = 0; i < k; ++i) {
    const double* row = X + static_cast<std::ptrdiff_t>(i) * stride;
    for (int c = 0; c <= i; c += width) {
      total += lanes_at(weight + c) * (lanes_at(row + c) * lanes_at(row + c));
    }
  }
  return sum_of(total);
}

}  // namespace

void transform_rows(const PackedRows& rows, std::span<const std::int32_t> cells,
                    std::span<const double> T, std::span<double> out, int level) {
  CHECK(out.size() == rows.data.size());
  CHECK(T.size() == static_cast<std::size_t>(rows.k) * static_cast<std::size_t>(rows.stride));
  const std::size_t total = cells.size() * static_cast<std::size_t>(rows.per_cell);
  const auto per_cell = static_cast<std::size_t>(rows.per_cell);
  on_level(
      level, [&]() __attribute__((always_inline)) {
        for (std::size_t first = 0; first < total; first += rows_together) {
          const double* in[rows_together];
          double* to[rows_together];
          for (std::size_t r = 0; r < rows_together; ++r) {
            const std::size_t row = std::min(first + r, total - 1);  // the last ones more than once
            in[r] = rows.of(cells[row / per_cell]) +
                    static_cast<std::ptrdiff_t>(row % per_cell) * rows.stride;
            to[r] = out.data() + (in[r] - rows.data.data());
          }
          transform_body(in, to, rows.k, rows.stride, T.data());
        }
      });
}

void column_energies(const PackedRows& rows, std::span<const std::int32_t> cells, int first,
                     std::span<double> energy, int level) {
  CHECK(first % width == 0 && energy.size() == static_cast<std::size_t>(rows.stride - first));
  on_level(
      level, [&]() __attribute__((always_inline)) {
        energies_body(rows, cells, first, energy.data());
      });
}

bool cholesky(std::span<double> A, int k, int stride, int level) {
  CHECK(A.size() >= static_cast<std::size_t>(k) * static_cast<std::size_t>(stride));
  return on_level(
      level, [&]() __attribute__((always_inline)) { return cholesky_body(A.data(), k, stride); });
}

void solve_with_factor(std::span<const double> R, int k, int stride, std::span<double> x,
                       int level) {
  CHECK(x.size() == static_cast<std::size_t>(stride));
  on_level(
      level, [&]() __attribute__((always_inline)) { solve_body(R.data(), k, stride, x.data()); });
}

void multiply(std::span<const double> A, int k, int stride, std::span<const double> x,
              std::span<double> product, int level) {
  CHECK(x.size() == static_cast<std::size_t>(stride) && product.size() == x.size());
  on_level(
      level, [&]() __attribute__((always_inline)) {
        multiply_body(A.data(), k, stride, x.data(), product.data());
      });
}

void invert_factor(std::span<const double> R, int k, int stride, std::span<double> inverse,
                   int level) {
  CHECK(inverse.size() >= static_cast<std::size_t>(k) * static_cast<std::size_t>(stride));
  on_level(
      level, [&]() __attribute__((always_inline)) {
        invert_body(R.data(), k, stride, inverse.data());
      });
}

double trace_of_inverse(std::span<const double> R, int k, int stride,
                        std::span<const double> weight, std::span<double> inverse, int level) {
  CHECK(inverse.size() >= static_cast<std::size_t>(k) * static_cast<std::size_t>(stride));
  CHECK(weight.size() >= static_cast<std::size_t>(stride));
  return on_level(
      level, [&]() __attribute__((always_inline)) {
        return trace_body(R.data(), k, stride, weight.data(), inverse.data());
      });
}

}  // namespace lightrig
