#include "daemon/session/image_numbers.h"

#include <OpenImageIO/imageio.h>
#include <fmt/format.h>

#include <system_error>

namespace lightrig {

namespace {

/// 1 GiB of floats: a header that asks for more is damaged.
constexpr OIIO::imagesize_t most_values = OIIO::imagesize_t{1} << 28;

}  // namespace

Result<ImageNumbers> read_image_numbers(const std::filesystem::path& path) {
  std::error_code ignored;
  if (!std::filesystem::exists(path, ignored)) {
    return fail(ErrorCode::not_found, fmt::format("read image '{}': no such file", path.string()));
  }
  const auto bad = [&](const std::string& why) {
    return fail(ErrorCode::invalid_input, fmt::format("read image '{}': {}", path.string(), why));
  };
  try {
    auto input = OIIO::ImageInput::open(path.string());
    if (!input) return bad(OIIO::geterror());
    input->threads(1);
    const OIIO::ImageSpec& spec = input->spec();
    if (static_cast<std::size_t>(spec.nchannels) != spec.channelnames.size() ||
        spec.image_pixels() * static_cast<OIIO::imagesize_t>(spec.nchannels) > most_values)
      return bad(fmt::format("{} × {} pixels of {} channels are more than a frame can have",
                             spec.width, spec.height, spec.nchannels));
    ImageNumbers image{spec.width, spec.height, spec.channelnames, {}};
    image.values.resize(static_cast<std::size_t>(spec.image_pixels()) * spec.channelnames.size());
    if (!input->read_image(0, 0, 0, spec.nchannels, OIIO::TypeDesc::FLOAT, image.values.data()) ||
        !input->close()) {
      return bad(input->geterror());
    }
    return image;
  } catch (const std::exception& error) {
    return bad(error.what());
  }
}

}  // namespace lightrig
