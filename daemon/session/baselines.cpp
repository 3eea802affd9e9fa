#include "daemon/session/baselines.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <thread>

#include "core/adaptive_fit.h"
#include "core/brdf_error.h"
#include "core/check.h"

namespace lightrig {
namespace {

constexpr Eigen::Index published_components = 45;

// SplitMix64 [Steele 2014]: small, and the same on every machine, as the standard's distributions
// are not.
class Random {
 public:
  explicit Random(std::uint64_t seed) : state_(seed) {}

  std::uint64_t bits() {
    std::uint64_t z = (state_ += 0x9E3779B97F4A7C15ULL);
    z = (z ^ (z >> 30)) * 0xBF58476D1CE4E5B9ULL;
    z = (z ^ (z >> 27)) * 0x94D049BB133111EBULL;
    return z ^ (z >> 31);
  }
  // Uniform in (0, 1).
  double uniform() { return (static_cast<double>(bits() >> 11) + 0.5) * 0x1p-53; }
  std::size_t below(std::size_t n) {
    return std::min(n - 1, static_cast<std::size_t>(uniform() * static_cast<double>(n)));
  }
  double normal() {
    return std::sqrt(-2 * std::log(uniform())) * std::cos(2 * std::numbers::pi * uniform());
  }

 private:
  std::uint64_t state_;
};

std::vector<int> pick(std::vector<int> candidates, int count, Random& random) {
  for (std::size_t i = 0; i < static_cast<std::size_t>(count); ++i) {
    std::swap(candidates[i], candidates[i + random.below(candidates.size() - i)]);
  }
  candidates.resize(static_cast<std::size_t>(count));
  return candidates;
}

BrdfObservations measure(const BrdfTable& reference, std::span<const std::int32_t> cells,
                         double floor, std::span<const double> noise, Random& random) {
  BrdfObservations light;
  for (Eigen::Index channel = 0; channel < reference.f.cols(); ++channel) {
    for (const std::int32_t cell : cells) {
      const double f = reference.f(cell, channel);
      if (!std::isfinite(f)) continue;
      BrdfObservation row;
      row.cell = cell;
      row.channel = static_cast<std::int8_t>(channel);
      row.count = 1;
      const double sigma = noise.empty() ? 0 : noise[random.below(noise.size())];
      const double mapped = std::max(f, floor);
      row.f = std::max(mapped * (1 + sigma * random.normal()), floor);
      row.variance = sigma * sigma * mapped * mapped;
      light.rows.push_back(row);
    }
  }
  return light;
}

double error_of(const BrdfBasis& basis, std::span<const BrdfObservations> lights,
                const BrdfTable& reference, Estimator estimator) {
  FitOptions options;
  options.estimator = estimator;
  const Coefficients fitted =
      fit_adaptive(basis, lights, static_cast<int>(reference.f.cols()), options).coefficients;
  return brdf_error(evaluate(basis, fitted.c), reference, basis.mapping.floor).percent_log;
}

double median(std::vector<double> values) {
  std::sort(values.begin(), values.end());
  const std::size_t n = values.size();
  return n % 2 == 1 ? values[n / 2] : 0.5 * (values[n / 2 - 1] + values[n / 2]);
}

}  // namespace

double mean_only_error(const BrdfBasis& basis, const BrdfTable& reference) {
  const bool stacked = basis.layout == ChannelLayout::stacked;
  const Eigen::MatrixXd none =
      Eigen::MatrixXd::Zero(basis.components(), stacked ? 1 : reference.f.cols());
  return brdf_error(evaluate(basis, none), reference, basis.mapping.floor).percent_log;
}

std::vector<double> relative_noise(std::span<const BrdfObservations> observations) {
  std::vector<double> noise;
  for (const BrdfObservations& light : observations) {
    for (const BrdfObservation& row : light.rows) {
      if (row.kind == BrdfObservation::Kind::value && row.f > 0) {
        noise.push_back(std::sqrt(row.variance) / row.f);
      }
    }
  }
  std::sort(noise.begin(), noise.end());
  return noise;
}

RandomLights random_lights(const BrdfBasis& basis, const CandidateBins& bins,
                           const BrdfTable& reference, std::span<const double> noise,
                           const RandomLightsOptions& options) {
  CHECK(options.sets > 0 && options.threads > 0);
  std::vector<int> candidates;
  for (int i = 0; i < bins.candidates(); ++i) {
    if (!bins.of(i).empty()) candidates.push_back(i);
  }
  RandomLights result;
  result.sets = options.sets;
  result.lights = std::min(options.lights, static_cast<int>(candidates.size()));
  const BrdfBasis published = truncated(basis, std::min(published_components, basis.components()));
  result.components = static_cast<int>(published.components());
  const auto sets = static_cast<std::size_t>(options.sets);
  std::vector<double> by_pseudo_inverse(sets), by_map(sets);
  const auto run = [&](std::size_t first, std::size_t stride) {
    for (std::size_t set = first; set < sets; set += stride) {
      Random random(options.seed * 0x9E3779B97F4A7C15ULL + set);
      std::vector<BrdfObservations> lights;
      for (const int candidate : pick(candidates, result.lights, random)) {
        lights.push_back(
            measure(reference, bins.of(candidate), basis.mapping.floor, noise, random));
      }
      by_pseudo_inverse[set] = error_of(published, lights, reference, Estimator::pseudo_inverse);
      by_map[set] = error_of(basis, lights, reference, Estimator::map);
    }
  };
  const auto stride = static_cast<std::size_t>(options.threads);
  {
    std::vector<std::jthread> workers;
    for (std::size_t t = 1; t < stride; ++t) workers.emplace_back(run, t, stride);
    run(0, stride);
  }
  result.pseudo_inverse_percent = median(by_pseudo_inverse);
  result.map_percent = median(by_map);
  return result;
}

}  // namespace lightrig
