#include <algorithm>
#include <cmath>
#include <limits>

#include "core/check.h"
#include "core/merge_hdr.h"

namespace lightrig {
namespace {

/// The dimmest twentieth of the lit sites are shadows' edges and grazing skin; above it stands the
/// dimmest site worth measuring.
constexpr double darkest_quantile = 0.05;
/// Full scale is left this far below saturation, as merge_hdr's own margin.
constexpr double margin = 0.02;

struct MeteredRates {
  std::vector<double> rate;  ///< [e⁻/s] of every lit site
  double brightest = 0;      ///< [e⁻/s]
  bool saturated = false;
};

double full_electrons(const SensorModel& sensor) {
  const double white = (sensor.white_level() * (1 - margin) - sensor.black_level) * sensor.gain;
  return sensor.full_well > 0 ? std::min(white, sensor.full_well * (1 - margin)) : white;
}

MeteredRates metered_rates(const Frame& metering, std::span<const std::uint8_t> lit,
                           const SensorModel& sensor) {
  MeteredRates out;
  const double full = full_electrons(sensor);
  for (std::size_t i = 0; i < lit.size(); ++i) {
    if (lit[i] == 0) continue;
    const double electrons = (metering.counts.counts[i] - sensor.black_level) * sensor.gain;
    out.saturated = out.saturated || electrons >= full;
    out.rate.push_back(electrons / metering.exposure - sensor.dark_current);
    out.brightest = std::max(out.brightest, out.rate.back());
  }
  return out;
}

double signal_to_noise(const SensorModel& sensor, double rate, double t) {
  const double variance = (rate + sensor.dark_current) * t + sensor.read_noise * sensor.read_noise +
                          sensor.gain * sensor.gain / 12;
  return rate * t / std::sqrt(variance);
}

}  // namespace

ExposureChoice choose_exposures(const Frame& metering, std::span<const std::uint8_t> lit,
                                std::span<const double> offered, const SensorModel& sensor,
                                double target_snr) {
  CHECK(!offered.empty() && std::is_sorted(offered.begin(), offered.end()));
  CHECK(lit.size() == metering.counts.counts.size() && metering.exposure > 0);
  MeteredRates metered = metered_rates(metering, lit, sensor);
  ExposureChoice choice;
  choice.brightest = metered.brightest;
  if (metered.rate.empty()) {
    // Nothing to measure here: one exposure documents that, the shortest.
    choice.exposures = {offered.front()};
    choice.skipped.assign(offered.begin() + 1, offered.end());
    return choice;
  }
  const auto at =
      static_cast<std::ptrdiff_t>(darkest_quantile * static_cast<double>(metered.rate.size()));
  std::nth_element(metered.rate.begin(), metered.rate.begin() + at, metered.rate.end());
  // A site below the metering frame's own noise may be anywhere below it.
  const double noise =
      std::sqrt(sensor.read_noise * sensor.read_noise + sensor.gain * sensor.gain / 12 +
                sensor.dark_current * metering.exposure) /
      metering.exposure;
  choice.darkest = std::max(metered.rate[static_cast<std::size_t>(at)], noise);

  const double full = full_electrons(sensor);
  std::size_t first = 0, last = 0;
  for (std::size_t i = 0; i < offered.size(); ++i) {
    const double filled = (metered.brightest + sensor.dark_current) * offered[i];
    // Where the metering frame itself is full the true rate is unknown, and only exposures well
    // below the metering one can be hoped to hold it: start from the shortest.
    if (!metered.saturated && filled < full) first = i;
    last = i;
    if (signal_to_noise(sensor, choice.darkest, offered[i]) >= target_snr) break;
  }
  last = std::max(first, last);
  for (std::size_t i = 0; i < offered.size(); ++i) {
    (i >= first && i <= last ? choice.exposures : choice.skipped).push_back(offered[i]);
  }
  return choice;
}

}  // namespace lightrig
