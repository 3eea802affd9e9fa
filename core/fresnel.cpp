#include "core/fresnel.h"

#include <algorithm>
#include <cmath>

namespace lightrig {
namespace {

// One channel. Snell gives the cosine in the medium, n' cos' = a + ib with
// (a + ib)² = (n + ik)² − sin²; then
//   Rs = ((a − c)² + b²)/((a + c)² + b²),
//   Rp = Rs · ((a − s²/c)² + b²)/((a + s²/c)² + b²), here multiplied through by c².
double unpolarised(double n, double k, double c) {
  const double s2 = 1 - c * c;
  const double re = n * n - k * k - s2;
  const double im = 2 * n * k;
  const double modulus = std::hypot(re, im);
  const double a = std::sqrt(std::max(0.0, 0.5 * (modulus + re)));
  const double b2 = std::max(0.0, 0.5 * (modulus - re));
  const double rs = ((a - c) * (a - c) + b2) / ((a + c) * (a + c) + b2);
  const double down = a * c - s2, up = a * c + s2;
  const double ratio = (down * down + b2 * c * c) / (up * up + b2 * c * c);
  return std::clamp(0.5 * rs * (1 + ratio), 0.0, 1.0);
}

// The same without absorption, which needs one root only.
double unpolarised(double n, double c) {
  const double inside = std::sqrt(std::max(0.0, n * n - 1 + c * c));  // n cos', 0 if total
  const double rs = (inside - c) / (inside + c), rp = (inside - n * n * c) / (inside + n * n * c);
  return std::min(1.0, 0.5 * (rs * rs + rp * rp));
}

}  // namespace

Eigen::Array3d fresnel(const RefractiveIndex& index, double cos_d) {
  const double c = std::clamp(cos_d, 0.0, 1.0);
  const bool grey = (index.n == index.n[0]).all() && (index.k == index.k[0]).all();
  if (grey && index.k[0] == 0) return Eigen::Array3d::Constant(unpolarised(index.n[0], c));
  const double red = unpolarised(index.n[0], index.k[0], c);
  if (grey) return Eigen::Array3d::Constant(red);
  return {red, unpolarised(index.n[1], index.k[1], c), unpolarised(index.n[2], index.k[2], c)};
}

}  // namespace lightrig
