#include "core/extreme_pair.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <numeric>

#include "core/symmetric_kernels.h"

namespace lightrig {

PairWork::PairWork(int k, int stride) {
  const auto size = static_cast<std::size_t>(k) * static_cast<std::size_t>(stride);
  A.resize(size);
  R.resize(size);
  z.resize(static_cast<std::size_t>(stride));
}

ExtremePair any_pair(int k, int stride) {
  ExtremePair pair;
  pair.x.assign(static_cast<std::size_t>(stride), 0.0);
  for (int i = 0; i < k; ++i) {
    pair.x[static_cast<std::size_t>(i)] = 1 + 0.5 * std::sin(1.0 + 3.0 * i);
  }
  normalize(pair.x);
  pair.y = pair.x;
  return pair;
}

double normalize(std::span<double> x) {
  double most = 0, sum = 0;
  for (const double v : x) most = std::max(most, std::abs(v));
  if (!(most > 0) || !std::isfinite(most) || !std::isfinite(1 / most)) return 0;
  for (double& v : x) {
    v *= 1 / most;
    sum += v * v;
  }
  const double length = std::sqrt(sum);
  for (double& v : x) v /= length;
  return most * length;
}

double refine_greatest(std::vector<double>& y, int k, int stride, int iterations, PairWork& work,
                       int level) {
  double top = 0;
  for (int i = 0; i < iterations; ++i) {
    multiply(work.A, k, stride, y, work.z, level);
    const double length = normalize(work.z);
    if (length == 0) break;
    y.swap(work.z);
    const bool settled = length - top <= 1e-3 * length;
    top = length;
    if (settled && i >= 1) break;
  }
  return top;
}

bool refine_least(std::vector<double>& x, double top, int k, int stride, int iterations,
                  PairWork& work, int level) {
  std::copy(work.A.begin(), work.A.end(), work.R.begin());
  if (!cholesky(work.R, k, stride, level)) return false;
  double last = std::numeric_limits<double>::infinity();
  for (int i = 0; i < iterations; ++i) {
    std::copy(x.begin(), x.end(), work.z.begin());
    solve_with_factor(work.R, k, stride, work.z, level);
    const double length = normalize(work.z);
    if (length == 0) return false;
    const double quotient = std::inner_product(x.begin(), x.end(), work.z.begin(), 0.0) / length;
    if (!(quotient > 1e-10 * top)) return false;
    x.swap(work.z);
    if (last - quotient <= 1e-7 * quotient) break;
    last = quotient;
  }
  return true;
}

void refine_least_by_factor(std::vector<double>& x, std::span<const double> R, int k, int stride,
                            PairWork& work, int level) {
  std::copy(x.begin(), x.end(), work.z.begin());
  for (int i = 0; i < 8; ++i) {
    solve_with_factor(R, k, stride, work.z, level);
    if (normalize(work.z) == 0) return;
    std::copy(work.z.begin(), work.z.end(), x.begin());
  }
}

double condition_bound(double low, double high, int k) {
  const double rounding = k * std::numeric_limits<double>::epsilon();
  const double least = std::sqrt(low) + rounding * std::sqrt(high);
  return (1 - 1e-11) * high / (least * least);
}

}  // namespace lightrig
