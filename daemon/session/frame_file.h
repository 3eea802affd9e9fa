#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "core/image.h"
#include "core/result.h"

namespace lightrig {

/// A frame as EXR bytes (OpenImageIO, one UINT channel "Y"; lossless; exposure and geometry of the
/// mosaic as attributes; nothing that changes from run to run, so equal frames are equal bytes),
/// encoded in memory.
Result<std::vector<std::byte>> encode_frame(const Frame& frame, ColorFilter filter);

/// Reads a frame file back. The frame's id is not in the file: it stands in the sidecar.
Result<Frame> read_frame(const std::filesystem::path& path);

/// A float image (rows · columns · channels, interleaved) as EXR bytes, channels named.
Result<std::vector<std::byte>> encode_float_exr(int width, int height,
                                                const std::vector<std::string>& channels,
                                                const std::vector<float>& pixels);

/// 8-bit sRGB PNG bytes (1, 3 or 4 channels).
Result<std::vector<std::byte>> encode_png(int width, int height, int channels,
                                          const std::vector<std::uint8_t>& pixels);

}  // namespace lightrig
