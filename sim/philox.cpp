#include "sim/philox.h"

#include <cmath>
#include <numbers>

namespace lightrig::sim {
namespace {

/// ln k! by Stirling's series from k = 10 on (error below 1e-12), by product below. Not lgamma,
/// which writes a global.
double log_factorial(double k) {
  if (k < 10) {
    double product = 1;
    for (double i = 2; i <= k; ++i) product *= i;
    return std::log(product);
  }
  const double r = 1 / k, r2 = r * r;
  return (k + 0.5) * std::log(k) - k + 0.5 * std::log(2 * std::numbers::pi) +
         r * (1.0 / 12 - r2 * (1.0 / 360 - r2 * (1.0 / 1260 - r2 / 1680)));
}

double poisson_by_inversion(double mean, std::uint32_t stream, PhiloxKey key) {
  const PhiloxCounter bits = philox({stream, 1, 0, 0}, key);
  const double u = uniform_open(bits[0], bits[1]);
  double k = 0, probability = std::exp(-mean), sum = probability;
  while (u > sum && k < 200) {  // P(k ≥ 200 | mean < 10) < 1e-170
    k += 1;
    probability *= mean / k;
    sum += probability;
  }
  return k;
}

double poisson_by_rejection(double mean, std::uint32_t stream, PhiloxKey key) {
  const double b = 0.931 + 2.53 * std::sqrt(mean);
  const double a = -0.059 + 0.02483 * b;
  const double inverse_alpha = 1.1239 + 1.1328 / (b - 3.4);
  const double v_r = 0.9277 - 3.6224 / (b - 2);
  const double log_mean = std::log(mean);
  for (std::uint32_t attempt = 1;; ++attempt) {
    const PhiloxCounter bits = philox({stream, attempt, 0, 0}, key);
    const double u = uniform_open(bits[0], bits[1]) - 0.5;
    const double v = uniform_open(bits[2], bits[3]);
    const double us = 0.5 - std::abs(u);
    const double k = std::floor((2 * a / us + b) * u + mean + 0.43);
    if (us >= 0.07 && v <= v_r) return k;
    if (k < 0 || (us < 0.013 && v > us)) continue;
    if (std::log(v * inverse_alpha / (a / (us * us) + b)) <=
        k * log_mean - mean - log_factorial(k)) {
      return k;
    }
  }
}

}  // namespace

PhiloxCounter philox(PhiloxCounter counter, PhiloxKey key) {
  for (int round = 0; round < 10; ++round) {
    const std::uint64_t product0 = std::uint64_t{0xD2511F53} * counter[0];
    const std::uint64_t product1 = std::uint64_t{0xCD9E8D57} * counter[2];
    counter = {static_cast<std::uint32_t>(product1 >> 32) ^ counter[1] ^ key[0],
               static_cast<std::uint32_t>(product1),
               static_cast<std::uint32_t>(product0 >> 32) ^ counter[3] ^ key[1],
               static_cast<std::uint32_t>(product0)};
    key[0] += 0x9E3779B9;
    key[1] += 0xBB67AE85;
  }
  return counter;
}

PhiloxKey derive_key(std::uint64_t seed, std::span<const std::uint64_t> words) {
  PhiloxKey key{static_cast<std::uint32_t>(seed), static_cast<std::uint32_t>(seed >> 32)};
  std::uint32_t index = 0;
  for (const std::uint64_t word : words) {
    const PhiloxCounter mixed =
        philox({static_cast<std::uint32_t>(word), static_cast<std::uint32_t>(word >> 32), ++index,
                0x6b657900},
               key);
    key = {mixed[0], mixed[1]};
  }
  return key;
}

double uniform_open(std::uint32_t high, std::uint32_t low) {
  // 52 bits, because with 53 the half added to the largest would round up to 1.
  const std::uint64_t bits = (std::uint64_t{high} << 20) ^ (low >> 12);
  return (static_cast<double>(bits) + 0.5) * 0x1p-52;
}

double poisson(double mean, std::uint32_t stream, PhiloxKey key) {
  if (!(mean > 0)) return 0;
  return mean < 10 ? poisson_by_inversion(mean, stream, key)
                   : poisson_by_rejection(mean, stream, key);
}

double standard_normal(std::uint32_t stream, PhiloxKey key) {
  const PhiloxCounter bits = philox({stream, 0, 0, 0}, key);
  const double radius = std::sqrt(-2 * std::log(uniform_open(bits[0], bits[1])));
  return radius * std::cos(2 * std::numbers::pi * uniform_open(bits[2], bits[3]));
}

}  // namespace lightrig::sim
