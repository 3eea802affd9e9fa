#include "sim/sensor_noise.h"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

namespace lightrig::sim {
namespace {

SensorModel lab_sensor() {
  SensorModel sensor;
  sensor.bits = 12;
  sensor.gain = 2.7;
  sensor.black_level = 64;
  sensor.read_noise = 6.5;
  sensor.dark_current = 3;
  sensor.full_well = 10000;
  sensor.response = Eigen::Array3d(50000, 40000, 30000);
  sensor.min_exposure = 1e-5;
  sensor.max_exposure = 10;
  return sensor;
}

struct Statistics {
  double mean = 0, variance = 0;
};

Statistics of_counts(const RawImage& image) {
  Statistics s;
  const auto n = static_cast<double>(image.counts.size());
  for (const std::uint16_t count : image.counts) s.mean += count / n;
  for (const std::uint16_t count : image.counts) {
    s.variance += (count - s.mean) * (count - s.mean) / (n - 1);
  }
  return s;
}

RawImage flat(const SensorModel& sensor, double radiance, double t, std::uint64_t seed) {
  const std::vector<float> sites(512 * 256, static_cast<float>(radiance));
  return *expose_sensor(sensor, 512, 256, sites, t, derive_key(seed, {}), 2, {});
}

TEST(ExposeSensor, ItsPhotonTransferCurveGivesBackGainAndReadNoise) {
  // EMVA 1288: σ² [DN²] = (μ − black)/K + (σ_read/K)² + 1/12; a line through the levels.
  const SensorModel sensor = lab_sensor();
  double sum_x = 0, sum_y = 0, sum_xx = 0, sum_xy = 0;
  const int levels = 12;
  for (int level = 0; level < levels; ++level) {
    const Statistics s =
        of_counts(flat(sensor, 0.012 * (level + 1), 1.0, 10U + static_cast<unsigned>(level)));
    const double x = s.mean - sensor.black_level;
    sum_x += x;
    sum_y += s.variance;
    sum_xx += x * x;
    sum_xy += x * s.variance;
  }
  const double slope = (levels * sum_xy - sum_x * sum_y) / (levels * sum_xx - sum_x * sum_x);
  const double offset = (sum_y - slope * sum_x) / levels;
  EXPECT_NEAR(1 / slope, sensor.gain, 0.02 * sensor.gain);
  EXPECT_NEAR(sensor.gain * std::sqrt(of_counts(flat(sensor, 0, 1e-5, 99)).variance - 1.0 / 12),
              sensor.read_noise, 0.01 * sensor.read_noise);
  EXPECT_NEAR(offset, std::pow(sensor.read_noise / sensor.gain, 2) + 1.0 / 12, 6);
}

TEST(ExposeSensor, TheMeanIsLinearInRadianceAndExposureDownToOneElectron) {
  const SensorModel sensor = lab_sensor();
  for (const double electrons : {1.0, 10.0, 100.0, 3000.0}) {
    for (const double t : {0.01, 1.0}) {
      const double dark = sensor.dark_current * t;
      const double radiance = electrons / (sensor.response[0] * t);
      const Statistics s = of_counts(flat(sensor, radiance, t, 3));
      const double sigma =
          std::sqrt((electrons + dark + 6.5 * 6.5) / (2.7 * 2.7) + 1.0 / 12) / std::sqrt(512 * 256);
      EXPECT_NEAR(s.mean, 64 + (electrons + dark) / 2.7, 5 * sigma + 1e-3);
    }
  }
}

TEST(ExposeSensor, ANoiselessSensorRoundsToTheNearestCount) {
  SensorModel sensor = lab_sensor();
  sensor.read_noise = 0;
  sensor.dark_current = 0;
  EXPECT_EQ(flat(sensor, 0, 1, 1).counts, std::vector<std::uint16_t>(512 * 256, 64));
  sensor.black_level = 63.5;
  EXPECT_EQ(flat(sensor, 0, 1, 1).counts.front(), 64);
  sensor.black_level = 63.49;
  EXPECT_EQ(flat(sensor, 0, 1, 1).counts.front(), 63);
}

TEST(ExposeSensor, FullWellAndWhiteLevelBothClip) {
  SensorModel sensor = lab_sensor();
  sensor.read_noise = 0;
  // Full well 10000 e⁻ at 2.7 e⁻/DN is 3703.7 DN above black, below the ADC's 4095.
  EXPECT_EQ(flat(sensor, 100, 1, 1).counts,
            std::vector<std::uint16_t>(512 * 256, static_cast<std::uint16_t>(3768)));
  sensor.full_well = 1e6;
  for (const int bits : {8, 10, 12, 14, 16}) {
    sensor.bits = bits;
    const RawImage image = flat(sensor, 100, 1, 1);
    EXPECT_EQ(image.counts.front(), (1 << bits) - 1);
  }
}

TEST(ExposeSensor, NoiseBelowBlackIsKeptUntilTheConverterEnds) {
  SensorModel sensor = lab_sensor();
  sensor.dark_current = 0;
  const RawImage lifted = flat(sensor, 0, 1, 7);
  int below = 0;
  for (const std::uint16_t count : lifted.counts) below += count < 64;
  EXPECT_NEAR(below / (512.0 * 256), 0.5 - 0.5 * std::erf(0.5 * 2.7 / 6.5 / std::sqrt(2.0)), 0.01);
  sensor.black_level = 0;
  for (const std::uint16_t count : flat(sensor, 0, 1, 7).counts) ASSERT_LE(count, 20);
}

TEST(ExposeSensor, BayerSitesUseTheirOwnChannel) {
  SensorModel sensor = lab_sensor();
  sensor.filter = ColorFilter::bayer_rggb;
  sensor.dark_current = 0;
  const RawImage image = flat(sensor, 0.1, 1, 4);
  double sums[2][2] = {{0, 0}, {0, 0}};
  for (int row = 0; row < 256; ++row) {
    for (int column = 0; column < 512; ++column) {
      sums[row % 2][column % 2] += image.counts[static_cast<std::size_t>(row * 512 + column)];
    }
  }
  const double n = 128 * 256;
  EXPECT_NEAR(sums[0][0] / n, 64 + 5000 / 2.7, 3);  // R
  EXPECT_NEAR(sums[0][1] / n, 64 + 4000 / 2.7, 3);  // G
  EXPECT_NEAR(sums[1][0] / n, 64 + 4000 / 2.7, 3);  // G
  EXPECT_NEAR(sums[1][1] / n, 64 + 3000 / 2.7, 3);  // B
}

TEST(ExposeSensor, NoiseBelongsToKeyAndSiteAndNotToThreads) {
  const SensorModel sensor = lab_sensor();
  const std::vector<float> sites(64 * 64, 0.05F);
  const PhiloxKey key = derive_key(1, {});
  const RawImage one = *expose_sensor(sensor, 64, 64, sites, 0.5, key, 1, {});
  EXPECT_EQ(one.counts, expose_sensor(sensor, 64, 64, sites, 0.5, key, 7, {})->counts);
  EXPECT_NE(one.counts,
            expose_sensor(sensor, 64, 64, sites, 0.5, derive_key(2, {}), 1, {})->counts);
  // Neighbouring sites and neighbouring keys are uncorrelated: |r| below 5/√n.
  const RawImage other = *expose_sensor(sensor, 64, 64, sites, 0.5, derive_key(2, {}), 1, {});
  const Statistics s = of_counts(one), s2 = of_counts(other);
  double along = 0, across = 0;
  for (std::size_t i = 0; i + 1 < one.counts.size(); ++i) {
    along += (one.counts[i] - s.mean) * (one.counts[i + 1] - s.mean);
    across += (one.counts[i] - s.mean) * (other.counts[i] - s2.mean);
  }
  const double n = 64 * 64;
  EXPECT_LT(std::abs(along / n / s.variance), 5 / std::sqrt(n));
  EXPECT_LT(std::abs(across / n / s.variance), 5 / std::sqrt(n));
}

}  // namespace
}  // namespace lightrig::sim
