#include "core/sensor.h"

#include <array>

#include "core/check.h"

namespace lightrig {

int channel_at(ColorFilter filter, int row, int column) {
  const int site = (row & 1) * 2 + (column & 1);  // 0 1 / 2 3 within the 2 × 2 block
  switch (filter) {
    case ColorFilter::mono:
      return 0;
    case ColorFilter::bayer_rggb:
      return std::array{0, 1, 1, 2}[static_cast<std::size_t>(site)];
    case ColorFilter::bayer_grbg:
      return std::array{1, 0, 2, 1}[static_cast<std::size_t>(site)];
    case ColorFilter::bayer_gbrg:
      return std::array{1, 2, 0, 1}[static_cast<std::size_t>(site)];
    case ColorFilter::bayer_bggr:
      return std::array{2, 1, 1, 0}[static_cast<std::size_t>(site)];
  }
  CHECK(false);
}

}  // namespace lightrig
