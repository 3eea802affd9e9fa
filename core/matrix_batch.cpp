#include "core/matrix_batch.h"

#include <algorithm>

#include "core/check.h"
#include "core/lanes.h"

namespace lightrig {

namespace {

static_assert(batch_size == lane_width);

/// Rows taken together: what they share is read once.
constexpr int rows_together = 4;

[[gnu::always_inline]] inline Lanes& at(double* p, int i) {
  return lanes_at(p + static_cast<std::ptrdiff_t>(i) * lane_width);
}
[[gnu::always_inline]] inline const Lanes& at(const double* p, int i) {
  return lanes_at(p + static_cast<std::ptrdiff_t>(i) * lane_width);
}
[[gnu::always_inline]] inline double* row(double* A, int i) {
  return A + batch_index(i, 0) * lane_width;
}
[[gnu::always_inline]] inline const double* row(const double* A, int i) {
  return A + batch_index(i, 0) * lane_width;
}

/// Row by row: w_ij = a_ij − Σ_{q<j} w_iq l_jq = l_ij d_j for j < i, then l_ij = w_ij / d_j and
/// d_i = a_ii − Σ w_ij l_ij.
[[gnu::always_inline]] inline void factor_body(double* A, int k, double* inverse) {
  const auto finish = [&](int i, int from) __attribute__((always_inline)) {
    double* a = row(A, i);
    for (int j = from; j < i; ++j) {
      const double* l = row(A, j);
      Lanes sum = at(a, j);
      for (int q = 0; q < j; ++q) sum -= at(a, q) * at(l, q);
      at(a, j) = sum;
    }
    Lanes pivot = at(a, i);
    for (int j = 0; j < i; ++j) {
      const Lanes w = at(a, j), l = w * at(inverse, j);
      pivot -= w * l;
      at(a, j) = l;
    }
    at(a, i) = pivot;
    at(inverse, i) = 1.0 / pivot;
  };
  int i = 0;
  for (; i + rows_together <= k; i += rows_together) {
    double *a0 = row(A, i), *a1 = row(A, i + 1), *a2 = row(A, i + 2), *a3 = row(A, i + 3);
    for (int j = 0; j < i; ++j) {
      const double* l = row(A, j);
      Lanes s0 = at(a0, j), s1 = at(a1, j), s2 = at(a2, j), s3 = at(a3, j);
      for (int q = 0; q < j; ++q) {
        const Lanes f = at(l, q);
        s0 -= at(a0, q) * f;
        s1 -= at(a1, q) * f;
        s2 -= at(a2, q) * f;
        s3 -= at(a3, q) * f;
      }
      at(a0, j) = s0;
      at(a1, j) = s1;
      at(a2, j) = s2;
      at(a3, j) = s3;
    }
    for (int r = i; r < i + rows_together; ++r) finish(r, i);
  }
  for (; i < k; ++i) finish(i, 0);
}

[[gnu::always_inline]] inline void solve_body(const double* L, int k, const double* inverse,
                                              double* x) {
  const int whole = k - k % rows_together;
  for (int i = 0; i < whole; i += rows_together) {
    const double *l0 = row(L, i), *l1 = row(L, i + 1), *l2 = row(L, i + 2), *l3 = row(L, i + 3);
    Lanes s0 = at(x, i), s1 = at(x, i + 1), s2 = at(x, i + 2), s3 = at(x, i + 3);
    for (int q = 0; q < i; ++q) {
      const Lanes z = at(x, q);
      s0 -= at(l0, q) * z;
      s1 -= at(l1, q) * z;
      s2 -= at(l2, q) * z;
      s3 -= at(l3, q) * z;
    }
    s1 -= at(l1, i) * s0;
    s2 -= at(l2, i) * s0 + at(l2, i + 1) * s1;
    s3 -= at(l3, i) * s0 + at(l3, i + 1) * s1 + at(l3, i + 2) * s2;
    at(x, i) = s0;
    at(x, i + 1) = s1;
    at(x, i + 2) = s2;
    at(x, i + 3) = s3;
  }
  for (int i = whole; i < k; ++i) {
    Lanes sum = at(x, i);
    for (int q = 0; q < i; ++q) sum -= at(row(L, i), q) * at(x, q);
    at(x, i) = sum;
  }
  for (int i = 0; i < k; ++i) at(x, i) *= at(inverse, i);
  for (int i = k - 1; i >= whole; --i) {
    const Lanes z = at(x, i);
    for (int q = 0; q < i; ++q) at(x, q) -= at(row(L, i), q) * z;
  }
  for (int i = whole - rows_together; i >= 0; i -= rows_together) {
    const double *l0 = row(L, i), *l1 = row(L, i + 1), *l2 = row(L, i + 2), *l3 = row(L, i + 3);
    const Lanes z3 = at(x, i + 3);
    const Lanes z2 = at(x, i + 2) - at(l3, i + 2) * z3;
    const Lanes z1 = at(x, i + 1) - at(l3, i + 1) * z3 - at(l2, i + 1) * z2;
    const Lanes z0 = at(x, i) - at(l3, i) * z3 - at(l2, i) * z2 - at(l1, i) * z1;
    at(x, i) = z0;
    at(x, i + 1) = z1;
    at(x, i + 2) = z2;
    for (int q = 0; q < i; ++q) {
      Lanes sum = at(x, q);
      sum -= at(l0, q) * z0;
      sum -= at(l1, q) * z1;
      sum -= at(l2, q) * z2;
      sum -= at(l3, q) * z3;
      at(x, q) = sum;
    }
  }
}

/// Each row of the lower triangle used as a row and as a column.
[[gnu::always_inline]] inline void multiply_body(const double* A, int k, const double* x,
                                                 double* y) {
  for (int i = 0; i < k; ++i) at(y, i) = at(row(A, i), i) * at(x, i);
  for (int i = 0; i < k; ++i) {
    const double* a = row(A, i);
    const Lanes factor = at(x, i);
    Lanes even{}, odd{};
    int q = 0;
    for (; q + 2 <= i; q += 2) {
      const Lanes b = at(a, q), c = at(a, q + 1);
      even += b * at(x, q);
      odd += c * at(x, q + 1);
      at(y, q) += b * factor;
      at(y, q + 1) += c * factor;
    }
    if (q < i) {
      even += at(a, q) * at(x, q);
      at(y, q) += at(a, q) * factor;
    }
    at(y, i) += even + odd;
  }
}

}  // namespace

void batch_factor(std::span<double> A, int k, std::span<double> inverse_diagonal, int level) {
  CHECK(A.size() == batch_matrix_size(k) && inverse_diagonal.size() == batch_vector_size(k));
  on_level(
      level, [&]() __attribute__((always_inline)) {
        factor_body(A.data(), k, inverse_diagonal.data());
      });
}

void batch_solve(std::span<const double> factor, int k, std::span<const double> inverse_diagonal,
                 std::span<double> x, int level) {
  CHECK(factor.size() == batch_matrix_size(k) && inverse_diagonal.size() == batch_vector_size(k) &&
        x.size() == batch_vector_size(k));
  on_level(
      level, [&]() __attribute__((always_inline)) {
        solve_body(factor.data(), k, inverse_diagonal.data(), x.data());
      });
}

void batch_multiply(std::span<const double> A, int k, std::span<const double> x,
                    std::span<double> product, int level) {
  CHECK(A.size() == batch_matrix_size(k) && x.size() == batch_vector_size(k) &&
        product.size() == x.size());
  on_level(
      level, [&]() __attribute__((always_inline)) {
        multiply_body(A.data(), k, x.data(), product.data());
      });
}

void batch_scale(std::span<double> x, std::span<const double> factors, int level) {
  CHECK(x.size() % lane_width == 0 && factors.size() == lane_width);
  on_level(
      level, [&]() __attribute__((always_inline)) {
        const Lanes factor = lanes_at(factors.data());
        for (std::size_t i = 0; i < x.size(); i += lane_width) lanes_at(x.data() + i) *= factor;
      });
}

void batch_dot(std::span<const double> x, std::span<const double> y, std::span<double> sums,
               int level) {
  CHECK(x.size() == y.size() && x.size() % lane_width == 0 && sums.size() == lane_width);
  on_level(
      level, [&]() __attribute__((always_inline)) {
        Lanes sum{};
        for (std::size_t i = 0; i < x.size(); i += lane_width) {
          sum += lanes_at(x.data() + i) * lanes_at(y.data() + i);
        }
        lanes_at(sums.data()) = sum;
      });
}

}  // namespace lightrig
