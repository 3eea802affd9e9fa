#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <span>
#include <vector>

namespace lightrig {

/// Linear light per pixel, before anybody looks at it; NaN where nothing is shown.
struct LinearImage {
  int width = 0, height = 0;
  std::vector<Eigen::Array3f> pixels;  ///< (height · width), rows from the top; any linear unit
};

/// 8-bit sRGB with alpha, ready for a PNG. Transparent where nothing is shown, so that a page may
/// be light or dark.
struct Picture {
  int width = 0, height = 0;
  std::vector<std::uint8_t> rgba;  ///< (height · width · 4)
};

/// sRGB byte of linear light in 0 … 1, clamped [IEC 61966-2-1].
std::uint8_t srgb_byte(double linear);

/// How linear light becomes brightness on a screen: scaled so that the log-average of the brighter
/// half of what is shown becomes a little over mid grey, highlights compressed up to `white`
/// [Reinhard 2002, eq. 4]. Chosen once and applied to every picture that is to be compared.
struct ToneMapping {
  double scale = 1;  ///< per unit of the image
  double white = 1;  ///< scaled luminance that becomes white
};
ToneMapping choose_tone(const LinearImage& image);
Picture tone_mapped(const LinearImage& image, const ToneMapping& tone);

/// Colours of a magnitude in 0 … 1 (dark to light, monotone in lightness, fit for colour-blind
/// readers and grey printing).
Eigen::Array3i sequential_colour(double t);
/// Colours of a signed quantity in −1 … 1: blue below, white at zero, red above.
Eigen::Array3i diverging_colour(double t);

/// Values through a colour map; NaN is transparent.
Picture false_colour(int width, int height, std::span<const float> values, double low, double high,
                     Eigen::Array3i (*colour)(double));

/// Pictures in a row, tops aligned, `gap` transparent pixels between them.
Picture beside(std::span<const Picture> pictures, int gap);

/// Every pixel repeated `factor` times both ways.
Picture enlarged(const Picture& picture, int factor);

}  // namespace lightrig
