#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "core/image.h"
#include "core/result.h"

namespace lightrig {

/// How a sensor's counts are laid out in a GigE Vision payload.
enum class PixelPacking : std::uint8_t {
  bytes,        ///< 8 bits, one byte each
  words,        ///< 10 … 16 bits in little-endian 16-bit words
  gev_packed,   ///< GigE Vision 1.x "Packed": two pixels in three bytes, high bytes outside, low
                ///< bits in the middle one
  pfnc_packed,  ///< PFNC "p": a stream of bits, least significant first
};

/// A pixel format by its GenICam name (PixelFormat enumeration).
struct PixelFormat {
  std::string name;        ///< e.g. "Mono12Packed", "BayerRG12"
  std::uint32_t code = 0;  ///< PFNC 32-bit value
  ColorFilter filter = ColorFilter::mono;
  int bits = 8;  ///< significant bits of a count
  PixelPacking packing = PixelPacking::bytes;
};

/// The formats lightrig decodes: Mono and the four Bayer orders at 8, 10, 12, 16 bits, plain,
/// Packed and p.
std::span<const PixelFormat> pixel_formats();
const PixelFormat* find_pixel_format(std::string_view name);
const PixelFormat* find_pixel_format(std::uint32_t code);

/// The plain (unpacked) format for a filter and bit depth; nullptr where GigE Vision has none (e.g.
/// 14 bits Bayer).
const PixelFormat* plain_pixel_format(ColorFilter filter, int bits);

/// Payload bytes of a width × height image.
std::size_t payload_bytes(const PixelFormat& format, int width, int height);

/// Counts from a payload. Errors: invalid_input when the payload is not exactly the size the format
/// asks for.
Result<RawImage> unpack(const PixelFormat& format, std::span<const std::byte> payload, int width,
                        int height);

/// The inverse, for the simulated camera. Counts are cut to the format's bits.
std::vector<std::byte> pack(const PixelFormat& format, const RawImage& image);

}  // namespace lightrig
