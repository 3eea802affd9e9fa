#include "core/slope_distribution.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "core/check.h"

namespace lightrig {
namespace {

constexpr double pi = std::numbers::pi;

double lambda_beckmann(double a) {
  // At large a both terms agree to all digits; what is left is below 1e-20.
  if (a > 6.5) return 0;
  return 0.5 * (std::exp(-a * a) / (a * std::sqrt(pi)) - std::erfc(a));
}

// ∫₀^φ sin^q, q > 0, by Simpson's rule in u with φ' = φ u⁵, which smooths the root at 0.
double integral_of_sine_power(double q, double phi) {
  constexpr int n = 32;
  double sum = 0;
  for (int i = 1; i <= n; ++i) {
    const double u = static_cast<double>(i) / n, u4 = u * u * u * u;
    const double weight = i == n ? 1 : (i % 2 == 1 ? 4 : 2);
    sum += weight * std::pow(std::sin(phi * u4 * u), q) * 5 * phi * u4;
  }
  return sum / (3 * n);
}

// Λ(a) = ∫ₐ^∞ (t/a − 1) p(t) dt for the marginal density p of one slope, here Student's
// C (1 + x²)^−s with x = t/√(γ − 1) and s = γ − ½, at a whole table of growing a. The first term is
// elementary. The second is, beyond the last a, a sine's power by x = cot φ, and from there
// downwards a sum of Simpson's rules in ln x.
std::vector<double> lambda_student(double tail, const std::vector<double>& a) {
  const double s = tail - 0.5, scale = std::sqrt(tail - 1);
  const double c = std::exp(std::lgamma(s) - std::lgamma(s - 0.5)) / std::sqrt(pi);
  const auto density = [&](double x) { return c * x * std::pow(1 + x * x, -s); };  // per ln x
  std::vector<double> lambda(a.size());
  double share_beyond = 0, upper = 0, density_above = 0;
  for (std::size_t k = a.size(); k-- > 0;) {
    const double x = a[k] / scale, density_here = density(x);
    share_beyond += k + 1 == a.size()
                        ? c * integral_of_sine_power(2 * s - 2, std::atan2(1.0, x))
                        : std::log(upper / x) / 6 *
                              (density_here + 4 * density(std::sqrt(upper * x)) + density_above);
    const double mean_beyond = c * std::pow(1 + x * x, 1 - s) / (2 * (s - 1)) / x;
    lambda[k] = std::max(0.0, mean_beyond - share_beyond);
    upper = x;
    density_above = density_here;
  }
  return lambda;
}

double lambda_ggx(double a) {
  return 0.5 / (a * (a + std::hypot(a, 1.0)));  // (√(1 + 1/a²) − 1)/2 without cancellation
}

}  // namespace

double normal_density(const SlopeDistribution& slopes, double sin2_h, double cos_h) {
  if (cos_h <= 0) return 0;
  const double alpha2 = slopes.roughness * slopes.roughness, cos2 = cos_h * cos_h;
  if (std::isinf(slopes.tail))
    return std::exp(-sin2_h / (cos2 * alpha2)) / (pi * alpha2 * cos2 * cos2);
  if (slopes.tail == 2) {
    const double q = alpha2 * cos2 + sin2_h;
    return alpha2 / (pi * q * q);
  }
  // 1/(π α² cos⁴) · (1 + tan²/((γ − 1) α²))^−γ
  const double q = 1 + sin2_h / (cos2 * (slopes.tail - 1) * alpha2);
  return std::pow(q, -slopes.tail) / (pi * alpha2 * cos2 * cos2);
}

double tan2_quantile(const SlopeDistribution& slopes, double u) {
  const double alpha2 = slopes.roughness * slopes.roughness;
  if (std::isinf(slopes.tail)) return -alpha2 * std::log1p(-u);
  return (slopes.tail - 1) * alpha2 * std::expm1(-std::log1p(-u) / (slopes.tail - 1));
}

SmithLambda::SmithLambda(double tail) {
  CHECK(tail > 1.5);
  std::vector<double> a(static_cast<std::size_t>(last) + 1);
  for (std::size_t i = 0; i < a.size(); ++i) a[i] = std::exp(first + step * static_cast<double>(i));
  if (std::isinf(tail) || tail == 2) {
    table_.resize(a.size());
    std::transform(a.begin(), a.end(), table_.begin(), tail == 2 ? lambda_ggx : lambda_beckmann);
  } else {
    table_ = lambda_student(tail, a);
  }
}

double SmithLambda::beyond(double ln_a) const {
  // Towards the horizon Λ grows as 1/a.
  return table_.front() * std::exp(first - ln_a);
}

}  // namespace lightrig
