#include "drivers/pixel_format.h"

#include <fmt/format.h>

#include <array>
#include <vector>

namespace lightrig {
namespace {

using enum PixelPacking;
using enum ColorFilter;

// PFNC values [EMVA PFNC 2.4, "Pixel Format Values"].
const std::vector<PixelFormat>& table() {
  static const std::vector<PixelFormat> formats = {
      {"Mono8", 0x01080001, mono, 8, bytes},
      {"Mono10", 0x01100003, mono, 10, words},
      {"Mono10Packed", 0x010c0004, mono, 10, gev_packed},
      {"Mono10p", 0x010a0046, mono, 10, pfnc_packed},
      {"Mono12", 0x01100005, mono, 12, words},
      {"Mono12Packed", 0x010c0006, mono, 12, gev_packed},
      {"Mono12p", 0x010c0047, mono, 12, pfnc_packed},
      {"Mono14", 0x01100025, mono, 14, words},
      {"Mono16", 0x01100007, mono, 16, words},
      {"BayerGR8", 0x01080008, bayer_grbg, 8, bytes},
      {"BayerRG8", 0x01080009, bayer_rggb, 8, bytes},
      {"BayerGB8", 0x0108000a, bayer_gbrg, 8, bytes},
      {"BayerBG8", 0x0108000b, bayer_bggr, 8, bytes},
      {"BayerGR10", 0x0110000c, bayer_grbg, 10, words},
      {"BayerRG10", 0x0110000d, bayer_rggb, 10, words},
      {"BayerGB10", 0x0110000e, bayer_gbrg, 10, words},
      {"BayerBG10", 0x0110000f, bayer_bggr, 10, words},
      {"BayerGR10Packed", 0x010c0026, bayer_grbg, 10, gev_packed},
      {"BayerRG10Packed", 0x010c0027, bayer_rggb, 10, gev_packed},
      {"BayerGB10Packed", 0x010c0028, bayer_gbrg, 10, gev_packed},
      {"BayerBG10Packed", 0x010c0029, bayer_bggr, 10, gev_packed},
      {"BayerGR10p", 0x010a0056, bayer_grbg, 10, pfnc_packed},
      {"BayerRG10p", 0x010a0058, bayer_rggb, 10, pfnc_packed},
      {"BayerGB10p", 0x010a0054, bayer_gbrg, 10, pfnc_packed},
      {"BayerBG10p", 0x010a0052, bayer_bggr, 10, pfnc_packed},
      {"BayerGR12", 0x01100010, bayer_grbg, 12, words},
      {"BayerRG12", 0x01100011, bayer_rggb, 12, words},
      {"BayerGB12", 0x01100012, bayer_gbrg, 12, words},
      {"BayerBG12", 0x01100013, bayer_bggr, 12, words},
      {"BayerGR12Packed", 0x010c002a, bayer_grbg, 12, gev_packed},
      {"BayerRG12Packed", 0x010c002b, bayer_rggb, 12, gev_packed},
      {"BayerGB12Packed", 0x010c002c, bayer_gbrg, 12, gev_packed},
      {"BayerBG12Packed", 0x010c002d, bayer_bggr, 12, gev_packed},
      {"BayerGR12p", 0x010c0057, bayer_grbg, 12, pfnc_packed},
      {"BayerRG12p", 0x010c0059, bayer_rggb, 12, pfnc_packed},
      {"BayerGB12p", 0x010c0055, bayer_gbrg, 12, pfnc_packed},
      {"BayerBG12p", 0x010c0053, bayer_bggr, 12, pfnc_packed},
      {"BayerGR16", 0x0110002e, bayer_grbg, 16, words},
      {"BayerRG16", 0x0110002f, bayer_rggb, 16, words},
      {"BayerGB16", 0x01100030, bayer_gbrg, 16, words},
      {"BayerBG16", 0x01100031, bayer_bggr, 16, words},
  };
  return formats;
}

std::uint32_t byte_at(std::span<const std::byte> data, std::size_t i) {
  return std::to_integer<std::uint32_t>(data[i]);
}

// GigE Vision Packed: byte 0 = high 8 bits of the first pixel, byte 2 = of the second; byte 1 holds
// their low bits, the first pixel's in the low nibble.
void unpack_gev(std::span<const std::byte> in, int low_bits, std::vector<std::uint16_t>& out) {
  const std::uint32_t mask = (1U << low_bits) - 1;
  for (std::size_t i = 0, b = 0; i < out.size(); i += 2, b += 3) {
    const std::uint32_t low = byte_at(in, b + 1);
    out[i] = static_cast<std::uint16_t>((byte_at(in, b) << low_bits) | (low & mask));
    if (i + 1 < out.size())
      out[i + 1] =
          static_cast<std::uint16_t>((byte_at(in, b + 2) << low_bits) | ((low >> 4) & mask));
  }
}

void pack_gev(const std::vector<std::uint16_t>& in, int low_bits, std::span<std::byte> out) {
  const std::uint32_t mask = (1U << low_bits) - 1;
  for (std::size_t i = 0, b = 0; i < in.size(); i += 2, b += 3) {
    const std::uint32_t first = in[i];
    const std::uint32_t second = i + 1 < in.size() ? in[i + 1] : 0U;
    out[b] = static_cast<std::byte>(first >> low_bits);
    out[b + 1] = static_cast<std::byte>((first & mask) | ((second & mask) << 4));
    if (b + 2 < out.size()) out[b + 2] = static_cast<std::byte>(second >> low_bits);
  }
}

void unpack_bits(std::span<const std::byte> in, int bits, std::vector<std::uint16_t>& out) {
  const std::uint32_t mask = (1U << bits) - 1;
  std::uint32_t pending = 0;
  int have = 0;
  std::size_t next = 0;
  for (std::uint16_t& count : out) {
    for (; have < bits; have += 8) pending |= byte_at(in, next++) << have;
    count = static_cast<std::uint16_t>(pending & mask);
    pending >>= bits;
    have -= bits;
  }
}

void pack_bits(const std::vector<std::uint16_t>& in, int bits, std::span<std::byte> out) {
  std::uint32_t pending = 0;
  int have = 0;
  std::size_t next = 0;
  for (const std::uint16_t count : in) {
    pending |= std::uint32_t{count} << have;
    for (have += bits; have >= 8; have -= 8, pending >>= 8)
      out[next++] = static_cast<std::byte>(pending & 0xff);
  }
  if (have > 0) out[next] = static_cast<std::byte>(pending & 0xff);
}

}  // namespace

std::span<const PixelFormat> pixel_formats() { return table(); }

const PixelFormat* find_pixel_format(std::string_view name) {
  for (const PixelFormat& format : table())
    if (format.name == name) return &format;
  return nullptr;
}

const PixelFormat* find_pixel_format(std::uint32_t code) {
  for (const PixelFormat& format : table())
    if (format.code == code) return &format;
  return nullptr;
}

const PixelFormat* plain_pixel_format(ColorFilter filter, int bits) {
  for (const PixelFormat& format : table())
    if (format.filter == filter && format.bits == bits &&
        (format.packing == bytes || format.packing == words))
      return &format;
  return nullptr;
}

std::size_t payload_bytes(const PixelFormat& format, int width, int height) {
  const std::size_t pixels = static_cast<std::size_t>(width) * static_cast<std::size_t>(height);
  switch (format.packing) {
    case bytes:
      return pixels;
    case words:
      return 2 * pixels;
    case gev_packed:
      return (pixels * 12 + 7) / 8;
    case pfnc_packed:
      return (pixels * static_cast<std::size_t>(format.bits) + 7) / 8;
  }
  return 0;
}

Result<RawImage> unpack(const PixelFormat& format, std::span<const std::byte> payload, int width,
                        int height) {
  const std::size_t expected = payload_bytes(format, width, height);
  if (payload.size() != expected)
    return fail(ErrorCode::invalid_input,
                fmt::format("{} × {} pixels of {} are {} bytes, but the frame has {}", width,
                            height, format.name, expected, payload.size()));
  RawImage image{width, height, {}};
  image.counts.resize(static_cast<std::size_t>(width) * static_cast<std::size_t>(height));
  switch (format.packing) {
    case bytes:
      for (std::size_t i = 0; i < image.counts.size(); ++i)
        image.counts[i] = static_cast<std::uint16_t>(byte_at(payload, i));
      break;
    case words:
      for (std::size_t i = 0; i < image.counts.size(); ++i)
        image.counts[i] = static_cast<std::uint16_t>(byte_at(payload, 2 * i) |
                                                     (byte_at(payload, 2 * i + 1) << 8));
      break;
    case gev_packed:
      unpack_gev(payload, format.bits - 8, image.counts);
      break;
    case pfnc_packed:
      unpack_bits(payload, format.bits, image.counts);
      break;
  }
  return image;
}

std::vector<std::byte> pack(const PixelFormat& format, const RawImage& image) {
  std::vector<std::byte> payload(payload_bytes(format, image.width, image.height));
  std::vector<std::uint16_t> counts = image.counts;
  const std::uint32_t mask = (1U << format.bits) - 1;
  for (std::uint16_t& count : counts) count = static_cast<std::uint16_t>(count & mask);
  switch (format.packing) {
    case bytes:
      for (std::size_t i = 0; i < counts.size(); ++i)
        payload[i] = static_cast<std::byte>(counts[i]);
      break;
    case words:
      for (std::size_t i = 0; i < counts.size(); ++i) {
        payload[2 * i] = static_cast<std::byte>(counts[i] & 0xff);
        payload[2 * i + 1] = static_cast<std::byte>(counts[i] >> 8);
      }
      break;
    case gev_packed:
      pack_gev(counts, format.bits - 8, payload);
      break;
    case pfnc_packed:
      pack_bits(counts, format.bits, payload);
      break;
  }
  return payload;
}

}  // namespace lightrig
