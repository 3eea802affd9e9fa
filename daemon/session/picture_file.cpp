#include "daemon/session/picture_file.h"

#include <OpenImageIO/imageio.h>
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <string>
#include <vector>

namespace lightrig {
namespace {

struct FloatPicture {
  int width = 0, height = 0, channels = 0;
  std::vector<float> values;  // (height · width · channels)

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
    FloatPicture picture{spec.width, spec.height, std::min(3, spec.nchannels), {}};
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

}  // namespace

Result<GreyImage> read_grey_image(const std::filesystem::path& file) {
  const auto picture = read_picture(file);
  if (!picture) return tl::unexpected(picture.error());
  GreyImage grey{picture->width, picture->height, {}};
  for (int y = 0; y < grey.height; ++y) {
    for (int x = 0; x < grey.width; ++x) {
      double sum = 0;
      for (int c = 0; c < picture->channels; ++c) sum += double{picture->at(x, y, c)};
      const double mean = 255 * sum / picture->channels;
      const double value = std::isfinite(mean) ? mean : 0;
      grey.pixels.push_back(static_cast<std::uint8_t>(std::lround(std::clamp(value, 0.0, 255.0))));
    }
  }
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
