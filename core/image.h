#pragma once

#include <cstdint>
#include <vector>

#include "core/sensor.h"

namespace lightrig {

/// Raw counts as the sensor gave them: one value per site, rows from the top.
struct RawImage {
  int width = 0, height = 0;
  std::vector<std::uint16_t> counts;  ///< (height · width) [DN]
};

/// A frame and the exposure it was really taken with.
struct Frame {
  RawImage counts;
  double exposure = 0;   ///< [s] as applied, read back
  std::uint64_t id = 0;  ///< the camera's own frame number
};

/// Linear radiance per sensor site (a Bayer mosaic stays a mosaic: each site knows one channel).
struct RadianceImage {
  enum class Site : std::uint8_t {
    measured,   ///< L and variance hold
    saturated,  ///< even the shortest exposure is: L is a lower bound
    dark,       ///< even the whole bracket stays under its noise: L and variance are an estimate
                ///< without bias (it may be negative) for whoever averages over sites; alone the
                ///< site says only that the radiance is below L + detection_sigma · √variance
  };
  int width = 0, height = 0;
  ColorFilter filter = ColorFilter::mono;
  std::vector<float> L;         ///< (height · width) [W m⁻² sr⁻¹]
  std::vector<float> variance;  ///< the same squared; infinite where saturated
  std::vector<Site> site;       ///< (height · width)
};

}  // namespace lightrig
