#include "daemon/session/frame_file.h"

#include <OpenImageIO/filesystem.h>
#include <OpenImageIO/imageio.h>
#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <cstring>
#include <span>
#include <system_error>

#include "core/check.h"

namespace lightrig {
namespace {

// OpenImageIO stamps the time of writing where none is given: equal images shall be equal bytes.
constexpr const char* fixed_date = "1970:01:01 00:00:00";

std::string_view name_of(ColorFilter filter) {
  switch (filter) {
    case ColorFilter::mono:
      return "mono";
    case ColorFilter::bayer_rggb:
      return "bayer_rggb";
    case ColorFilter::bayer_grbg:
      return "bayer_grbg";
    case ColorFilter::bayer_gbrg:
      return "bayer_gbrg";
    case ColorFilter::bayer_bggr:
      return "bayer_bggr";
  }
  return "unknown";
}

/// Writes an image into memory, with every return and the library's error state looked at: some of
/// its writers report failure in one of them only.
Result<std::vector<std::byte>> encode(const char* format, const OIIO::ImageSpec& spec,
                                      OIIO::TypeDesc type, const void* pixels) {
  try {
    auto output = OIIO::ImageOutput::create(format);
    if (!output || output->supports("ioproxy") == 0) {
      return fail(ErrorCode::not_built,
                  fmt::format("encode a {} image: this OpenImageIO cannot write {} into memory; "
                              "install Debian 12's libopenimageio2.4",
                              format, format));
    }
    output->threads(1);
    std::vector<unsigned char> bytes;
    OIIO::Filesystem::IOVecOutput memory(bytes);
    const bool good = output->set_ioproxy(&memory) && output->open("memory", spec) &&
                      output->write_image(type, pixels) && output->close();
    if (!good || output->has_error()) {
      return fail(ErrorCode::refused, fmt::format("encode a {} image of {} × {}: {}", format,
                                                  spec.width, spec.height, output->geterror()));
    }
    std::vector<std::byte> result(bytes.size());
    std::memcpy(result.data(), bytes.data(), bytes.size());
    return result;
  } catch (const std::exception& error) {
    return fail(ErrorCode::refused, fmt::format("encode a {} image: {}", format, error.what()));
  }
}

OIIO::ImageSpec exr_spec(int width, int height, int channels, OIIO::TypeDesc type) {
  OIIO::ImageSpec spec(width, height, channels, type);
  spec.attribute("compression", "zips");
  spec.attribute("DateTime", fixed_date);
  spec.attribute("oiio:ColorSpace", "linear");
  return spec;
}

tl::unexpected<Error> bad_frame(const std::filesystem::path& path, const std::string& why) {
  return fail(ErrorCode::invalid_input, fmt::format("read frame '{}': {}", path.string(), why));
}

}  // namespace

Result<std::vector<std::byte>> encode_frame(const Frame& frame, const SensorModel& sensor,
                                            const FrameFacts& facts) {
  const RawImage& raw = frame.counts;
  CHECK(raw.width > 0 && raw.height > 0);
  CHECK(raw.counts.size() ==
        static_cast<std::size_t>(raw.width) * static_cast<std::size_t>(raw.height));
  // OpenEXR has no 16-bit integers: 32-bit ones hold every count exactly, and compress to what
  // they carry.
  const std::vector<std::uint32_t> wide(raw.counts.begin(), raw.counts.end());
  OIIO::ImageSpec spec = exr_spec(raw.width, raw.height, 1, OIIO::TypeDesc::UINT32);
  spec.channelnames = {"Y"};
  spec.attribute("ExposureTime", static_cast<float>(frame.exposure));
  // The exposure again as text: the standard attribute is single precision.
  spec.attribute("lightrig:exposure_s", fmt::format("{}", frame.exposure));
  spec.attribute("lightrig:color_filter", std::string(name_of(sensor.filter)));
  spec.attribute("lightrig:bits", sensor.bits);
  spec.attribute("lightrig:black_level_dn", static_cast<float>(sensor.black_level));
  spec.attribute("lightrig:gain_e_per_dn", static_cast<float>(sensor.gain));
  if (!facts.file.empty()) spec.attribute("lightrig:frame", facts.file);
  if (!facts.role.empty()) spec.attribute("lightrig:role", facts.role);
  return encode("exr", spec, OIIO::TypeDesc::UINT32, wide.data());
}

Result<Frame> read_frame(const std::filesystem::path& path) {
  std::error_code ignored;
  if (!std::filesystem::exists(path, ignored)) {
    return fail(ErrorCode::not_found, fmt::format("read frame '{}': no such file", path.string()));
  }
  try {
    auto input = OIIO::ImageInput::open(path.string());
    if (!input) return bad_frame(path, OIIO::geterror());
    input->threads(1);
    const OIIO::ImageSpec& spec = input->spec();
    if (spec.nchannels != 1 || spec.format != OIIO::TypeDesc::UINT32) {
      return bad_frame(path, fmt::format("{} channel(s) of type {}, expected one of type uint: not "
                                         "a frame that lightrig stored",
                                         spec.nchannels, spec.format.c_str()));
    }
    Frame frame;
    const std::string exposure = spec.get_string_attribute("lightrig:exposure_s");
    const auto parsed =
        std::from_chars(exposure.data(), exposure.data() + exposure.size(), frame.exposure);
    if (parsed.ec != std::errc{} || !(frame.exposure > 0)) {
      return bad_frame(path,
                       "the attribute lightrig:exposure_s is missing or not a positive number");
    }
    std::vector<std::uint32_t> wide(static_cast<std::size_t>(spec.image_pixels()));
    if (!input->read_image(0, 0, 0, 1, OIIO::TypeDesc::UINT32, wide.data()) || !input->close()) {
      return bad_frame(path, input->geterror());
    }
    if (std::ranges::any_of(wide, [](std::uint32_t count) { return count > 0xFFFFU; })) {
      return bad_frame(path, "a count above 65535: damaged");
    }
    frame.counts.width = spec.width;
    frame.counts.height = spec.height;
    frame.counts.counts.resize(wide.size());
    std::ranges::transform(wide, frame.counts.counts.begin(),
                           [](std::uint32_t count) { return static_cast<std::uint16_t>(count); });
    return frame;
  } catch (const std::exception& error) {
    return bad_frame(path, error.what());
  }
}

Result<std::vector<std::byte>> encode_float_exr(int width, int height,
                                                const std::vector<std::string>& channels,
                                                const std::vector<float>& pixels) {
  CHECK(width > 0 && height > 0 && !channels.empty());
  CHECK(pixels.size() ==
        static_cast<std::size_t>(width) * static_cast<std::size_t>(height) * channels.size());
  OIIO::ImageSpec spec =
      exr_spec(width, height, static_cast<int>(channels.size()), OIIO::TypeDesc::FLOAT);
  spec.channelnames = channels;
  return encode("exr", spec, OIIO::TypeDesc::FLOAT, pixels.data());
}

Result<std::vector<std::byte>> encode_png(int width, int height, int channels,
                                          const std::vector<std::uint8_t>& pixels,
                                          double pixels_per_m) {
  CHECK(width > 0 && height > 0 && (channels == 1 || channels == 3 || channels == 4));
  CHECK(pixels.size() == static_cast<std::size_t>(width) * static_cast<std::size_t>(height) *
                             static_cast<std::size_t>(channels));
  OIIO::ImageSpec spec(width, height, channels, OIIO::TypeDesc::UINT8);
  spec.attribute("oiio:ColorSpace", "sRGB");
  if (pixels_per_m > 0) {
    spec.attribute("ResolutionUnit", "m");
    spec.attribute("XResolution", static_cast<float>(std::round(pixels_per_m)));
    spec.attribute("YResolution", static_cast<float>(std::round(pixels_per_m)));
  }
  return encode("png", spec, OIIO::TypeDesc::UINT8, pixels.data());
}

}  // namespace lightrig
