#pragma once

#include <Eigen/Core>
#include <cstdint>

namespace lightrig {

enum class ColorFilter : std::uint8_t { mono, bayer_rggb, bayer_grbg, bayer_gbrg, bayer_bggr };

/// A linear sensor, in the terms of EMVA 1288.
/// counts [DN] = black_level + electrons / gain, electrons = response · radiance · exposure +
/// dark_current · exposure.
struct SensorModel {
  ColorFilter filter = ColorFilter::mono;
  int bits = 12;            ///< 8 … 16
  double gain = 1;          ///< [e⁻/DN]
  double black_level = 0;   ///< [DN]
  double read_noise = 0;    ///< [e⁻] rms
  double dark_current = 0;  ///< [e⁻/s]
  double full_well = 0;     ///< [e⁻]
  Eigen::Array3d response =
      Eigen::Array3d::Ones();  ///< [e⁻/s per W m⁻² sr⁻¹] of the R, G, B (or one mono) sites
  double min_exposure = 0, max_exposure = 0;  ///< [s]

  int channels() const { return filter == ColorFilter::mono ? 1 : 3; }
  int white_level() const { return (1 << bits) - 1; }
};

/// Channel (0 R, 1 G, 2 B; mono 0) of the site at row, column.
int channel_at(ColorFilter filter, int row, int column);

}  // namespace lightrig
