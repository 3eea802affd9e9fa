#include "daemon/session/picture.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>

#include "core/check.h"

namespace lightrig {
namespace {

// The brighter half of a picture is brought to this level: a little above mid grey.
constexpr double middle = 0.28;

// Luminance of linear sRGB primaries [ITU-R BT.709].
double luminance(const Eigen::Array3f& rgb) {
  return 0.2126 * static_cast<double>(rgb[0]) + 0.7152 * static_cast<double>(rgb[1]) +
         0.0722 * static_cast<double>(rgb[2]);
}

template <std::size_t N>
Eigen::Array3i interpolate(const std::array<std::array<int, 3>, N>& stops, double t) {
  const double x = std::clamp(t, 0.0, 1.0) * static_cast<double>(N - 1);
  const auto i = std::min(static_cast<std::size_t>(x), N - 2);
  const double w = x - static_cast<double>(i);
  Eigen::Array3i colour;
  for (std::size_t c = 0; c < 3; ++c) {
    colour[static_cast<int>(c)] = static_cast<int>(std::lround(
        (1 - w) * static_cast<double>(stops[i][c]) + w * static_cast<double>(stops[i + 1][c])));
  }
  return colour;
}

void put(Picture& picture, std::size_t pixel, const Eigen::Array3i& colour) {
  for (int c = 0; c < 3; ++c) {
    picture.rgba[4 * pixel + static_cast<std::size_t>(c)] = static_cast<std::uint8_t>(colour[c]);
  }
  picture.rgba[4 * pixel + 3] = 255;
}

Picture blank(int width, int height) {
  return {width, height,
          std::vector<std::uint8_t>(4 * static_cast<std::size_t>(width) *
                                    static_cast<std::size_t>(height))};
}

}  // namespace

std::uint8_t srgb_byte(double linear) {
  const double x = std::clamp(linear, 0.0, 1.0);
  const double encoded = x <= 0.0031308 ? 12.92 * x : 1.055 * std::pow(x, 1 / 2.4) - 0.055;
  return static_cast<std::uint8_t>(std::lround(255 * encoded));
}

ToneMapping choose_tone(const LinearImage& image) {
  std::vector<double> shown;
  shown.reserve(image.pixels.size());
  for (const Eigen::Array3f& pixel : image.pixels) {
    const double y = luminance(pixel);
    if (y > 0 && std::isfinite(y)) shown.push_back(y);
  }
  if (shown.empty()) return {};
  std::sort(shown.begin(), shown.end());
  // Shadows and the black around an object must not pull the average down: the upper half speaks.
  const std::size_t half = shown.size() / 2;
  double sum = 0;
  for (std::size_t i = half; i < shown.size(); ++i) sum += std::log(shown[i]);
  const double average = std::exp(sum / static_cast<double>(shown.size() - half));
  const double scale = middle / average;
  const auto near_brightest =
      static_cast<std::size_t>(0.998 * static_cast<double>(shown.size() - 1));
  return {scale, std::max(1.0, scale * shown[near_brightest])};
}

Picture tone_mapped(const LinearImage& image, const ToneMapping& tone) {
  Picture picture = blank(image.width, image.height);
  const double white2 = tone.white * tone.white;
  for (std::size_t i = 0; i < image.pixels.size(); ++i) {
    const Eigen::Array3f& pixel = image.pixels[i];
    if (!pixel.isFinite().all()) continue;
    const double y = std::max(0.0, tone.scale * luminance(pixel));
    const double shrink = tone.scale * (1 + y / white2) / (1 + y);
    Eigen::Array3i colour;
    for (int c = 0; c < 3; ++c) colour[c] = srgb_byte(shrink * static_cast<double>(pixel[c]));
    put(picture, i, colour);
  }
  return picture;
}

Eigen::Array3i sequential_colour(double t) {
  // Anchors of matplotlib's viridis (CC0).
  static constexpr std::array<std::array<int, 3>, 10> stops{{{68, 1, 84},
                                                             {72, 40, 120},
                                                             {62, 73, 137},
                                                             {49, 104, 142},
                                                             {38, 130, 142},
                                                             {31, 158, 137},
                                                             {53, 183, 121},
                                                             {110, 206, 88},
                                                             {181, 222, 43},
                                                             {253, 231, 37}}};
  return interpolate(stops, t);
}

Eigen::Array3i diverging_colour(double t) {
  // Anchors of ColorBrewer's RdBu, blue first (Apache-2.0).
  static constexpr std::array<std::array<int, 3>, 9> stops{{{33, 102, 172},
                                                            {67, 147, 195},
                                                            {146, 197, 222},
                                                            {209, 229, 240},
                                                            {247, 247, 247},
                                                            {253, 219, 199},
                                                            {244, 165, 130},
                                                            {214, 96, 77},
                                                            {178, 24, 43}}};
  return interpolate(stops, 0.5 * (t + 1));
}

Picture false_colour(int width, int height, std::span<const float> values, double low, double high,
                     Eigen::Array3i (*colour)(double)) {
  CHECK(values.size() == static_cast<std::size_t>(width) * static_cast<std::size_t>(height));
  CHECK(high > low);
  Picture picture = blank(width, height);
  const bool is_signed = low < 0;
  for (std::size_t i = 0; i < values.size(); ++i) {
    const auto value = static_cast<double>(values[i]);
    if (std::isnan(value)) continue;
    const double t = (std::clamp(value, low, high) - low) / (high - low);
    put(picture, i, colour(is_signed ? 2 * t - 1 : t));
  }
  return picture;
}

Picture beside(std::span<const Picture> pictures, int gap) {
  int width = 0, height = 0;
  for (const Picture& picture : pictures) {
    width += picture.width + (width > 0 ? gap : 0);
    height = std::max(height, picture.height);
  }
  Picture row = blank(width, height);
  int left = 0;
  for (const Picture& picture : pictures) {
    const auto bytes = 4 * static_cast<std::ptrdiff_t>(picture.width);
    for (int y = 0; y < picture.height; ++y) {
      std::copy_n(picture.rgba.begin() + y * bytes, bytes,
                  row.rgba.begin() + 4 * (static_cast<std::ptrdiff_t>(y) * width + left));
    }
    left += picture.width + gap;
  }
  return row;
}

Picture enlarged(const Picture& picture, int factor) {
  CHECK(factor >= 1);
  Picture large = blank(picture.width * factor, picture.height * factor);
  for (int y = 0; y < large.height; ++y) {
    for (int x = 0; x < large.width; ++x) {
      const auto from = 4 * (static_cast<std::ptrdiff_t>(y / factor) * picture.width + x / factor);
      const auto to = 4 * (static_cast<std::ptrdiff_t>(y) * large.width + x);
      std::copy_n(picture.rgba.begin() + from, 4, large.rgba.begin() + to);
    }
  }
  return large;
}

}  // namespace lightrig
