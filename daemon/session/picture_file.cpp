#include "daemon/session/picture_file.h"

#include <OpenImageIO/imageio.h>
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <string>
#include <vector>

namespace lightrig {
namespace {

struct FloatPicture {
  int width = 0, height = 0, channels = 0;
  std::vector<float> values;  // (height · width · channels)
  bool deep = false;          // more than 8 bits a value
  bool mosaic = false;        // a stored frame of a Bayer sensor

  float at(int x, int y, int channel) const {
    const auto i = (static_cast<std::size_t>(y) * static_cast<std::size_t>(width) +
                    static_cast<std::size_t>(x)) *
                   static_cast<std::size_t>(channels);
    return values[i + static_cast<std::size_t>(std::min(channel, channels - 1))];
  }
};

Result<FloatPicture> read_picture(const std::filesystem::path& file) {
  try {
    auto input = OIIO::ImageInput::open(file.string());
    if (!input)
      return fail(ErrorCode::not_found,
                  fmt::format("read the picture \"{}\": {}", file.string(), OIIO::geterror()));
    const OIIO::ImageSpec& spec = input->spec();
    if (spec.width < 1 || spec.height < 1 || spec.nchannels < 1 ||
        static_cast<double>(spec.width) * spec.height > double{1 << 28})
      return fail(
          ErrorCode::invalid_input,
          fmt::format("read the picture \"{}\": {} × {} pixels of {} channels cannot be used",
                      file.string(), spec.width, spec.height, spec.nchannels));
    FloatPicture picture{spec.width, spec.height, std::min(3, spec.nchannels), {}, {}, {}};
    picture.deep = spec.format.size() > 1;
    picture.mosaic =
        std::string(spec.get_string_attribute("lightrig:color_filter")).starts_with("bayer");
    picture.values.resize(static_cast<std::size_t>(picture.width) *
                          static_cast<std::size_t>(picture.height) *
                          static_cast<std::size_t>(picture.channels));
    if (!input->read_image(0, 0, 0, picture.channels, OIIO::TypeDesc::FLOAT, picture.values.data()))
      return fail(ErrorCode::invalid_input,
                  fmt::format("read the picture \"{}\": {}", file.string(), input->geterror()));
    return picture;
  } catch (const std::exception& e) {
    return fail(ErrorCode::invalid_input,
                fmt::format("read the picture \"{}\": {}", file.string(), e.what()));
  }
}

// Where the darkest and the brightest of a deep picture come to lie: what is beyond the percentiles
// has room to differ still, so that the noise of a white that is most of the picture is not cut
// off.
constexpr double low_percentile = 0.005, high_percentile = 0.995;
constexpr double low_grey = 15, high_grey = 235;

/// Spreads the values of every `step`th row and column, from `first` on, over the greys.
void stretch(std::vector<double>& values, int width, int height, std::array<int, 2> first,
             int step) {
  std::vector<double> seen;
  const auto each = [&](auto&& use) {
    for (int y = first[1]; y < height; y += step)
      for (int x = first[0]; x < width; x += step)
        use(values[static_cast<std::size_t>(y) * static_cast<std::size_t>(width) +
                   static_cast<std::size_t>(x)]);
  };
  each([&](double value) { seen.push_back(value); });
  if (seen.empty()) return;
  const auto at = [&](double share) {
    const auto nth = seen.begin() + std::lround(share * static_cast<double>(seen.size() - 1));
    std::nth_element(seen.begin(), nth, seen.end());
    return *nth;
  };
  const double low = at(low_percentile), high = at(high_percentile);
  const double scale = high > low ? (high_grey - low_grey) / (high - low) : 0;
  each([&](double& value) { value = low_grey + scale * (value - low); });
}

}  // namespace

Result<GreyImage> read_grey_image(const std::filesystem::path& file) {
  const auto picture = read_picture(file);
  if (!picture) return tl::unexpected(picture.error());
  std::vector<double> values;
  for (int y = 0; y < picture->height; ++y) {
    for (int x = 0; x < picture->width; ++x) {
      double sum = 0;
      for (int c = 0; c < picture->channels; ++c) sum += double{picture->at(x, y, c)};
      const double mean = 255 * sum / picture->channels;
      values.push_back(std::isfinite(mean) ? mean : 0);
    }
  }
  if (picture->deep) {
    // A mosaic's sites see black and white through filters of their own.
    const int step = picture->mosaic ? 2 : 1;
    for (int row = 0; row < step; ++row)
      for (int column = 0; column < step; ++column)
        stretch(values, picture->width, picture->height, {column, row}, step);
  }
  GreyImage grey{picture->width, picture->height, {}};
  for (const double value : values)
    grey.pixels.push_back(static_cast<std::uint8_t>(std::lround(std::clamp(value, 0.0, 255.0))));
  return grey;
}

Result<Environment> read_environment(const std::filesystem::path& file) {
  const auto picture = read_picture(file);
  if (!picture) return tl::unexpected(picture.error());
  if (picture->width != 2 * picture->height)
    return fail(ErrorCode::invalid_input,
                fmt::format("light a sphere by \"{}\": it is {} × {} pixels; a latitude-longitude "
                            "picture is twice as wide as high",
                            file.string(), picture->width, picture->height));
  const bool any_light =
      std::ranges::any_of(picture->values, [](float v) { return std::isfinite(v) && v > 0; });
  if (!any_light)
    return fail(ErrorCode::invalid_input,
                fmt::format("light a sphere by \"{}\": it holds no light", file.string()));
  const FloatPicture& p = *picture;
  const auto radiance = [&p](const Eigen::Vector3d& d) -> Eigen::Array3f {
    // +z is towards the viewer, at the middle column; turning right from there is towards −x.
    const double around = std::atan2(-d.x(), d.z());
    const double down = std::acos(std::clamp(d.y(), -1.0, 1.0));
    const double u = (0.5 + around / (2 * std::numbers::pi)) * p.width - 0.5;
    const double v = down / std::numbers::pi * p.height - 0.5;
    const int x0 = static_cast<int>(std::floor(u)), y0 = static_cast<int>(std::floor(v));
    Eigen::Array3f sum = Eigen::Array3f::Zero();
    for (int corner = 0; corner < 4; ++corner) {
      const int x = ((x0 + corner % 2) % p.width + p.width) % p.width;
      const int y = std::clamp(y0 + corner / 2, 0, p.height - 1);
      const double share =
          std::abs(1 - corner % 2 - (u - x0)) * std::abs(1 - corner / 2 - (v - y0));
      for (int c = 0; c < 3; ++c) {
        const float value = p.at(x, y, c);
        if (std::isfinite(value)) sum[c] += static_cast<float>(share) * std::max(0.0F, value);
      }
    }
    return sum;
  };
  return Environment(radiance, 512);
}

}  // namespace lightrig
