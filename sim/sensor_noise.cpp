#include "sim/sensor_noise.h"

#include <algorithm>
#include <cmath>

#include "core/check.h"
#include "sim/parallel.h"

namespace lightrig::sim {
namespace {

std::uint16_t digitise(const SensorModel& sensor, double mean, std::uint32_t site, PhiloxKey key) {
  // More than 12 standard deviations above full well the well is full: P(otherwise) < 1e-32.
  const bool surely_full = mean - 12 * std::sqrt(mean) > sensor.full_well;
  double electrons =
      surely_full ? sensor.full_well : std::min(poisson(mean, site, key), sensor.full_well);
  if (sensor.read_noise > 0) electrons += sensor.read_noise * standard_normal(site, key);
  const double counts = std::floor(sensor.black_level + electrons / sensor.gain + 0.5);
  return static_cast<std::uint16_t>(
      std::clamp(counts, 0.0, static_cast<double>(sensor.white_level())));
}

}  // namespace

double expected_electrons(const SensorModel& sensor, int channel, double radiance, double t) {
  return (sensor.response[channel] * radiance + sensor.dark_current) * t;
}

std::optional<RawImage> expose_sensor(const SensorModel& sensor, int width, int height,
                                      std::span<const float> radiance, double t, PhiloxKey key,
                                      int threads, const std::stop_token& stop) {
  CHECK(radiance.size() == static_cast<std::size_t>(width) * static_cast<std::size_t>(height));
  CHECK(sensor.bits >= 8 && sensor.bits <= 16 && sensor.gain > 0);
  RawImage image{width, height, std::vector<std::uint16_t>(radiance.size())};
  in_parallel(threads, height, stop, [&](int row) {
    auto site = static_cast<std::uint32_t>(row) * static_cast<std::uint32_t>(width);
    for (int column = 0; column < width; ++column, ++site) {
      const int channel = channel_at(sensor.filter, row, column);
      const double mean =
          expected_electrons(sensor, channel, static_cast<double>(radiance[site]), t);
      image.counts[site] = digitise(sensor, mean, site, key);
    }
  });
  if (stop.stop_requested()) return std::nullopt;
  return image;
}

}  // namespace lightrig::sim
