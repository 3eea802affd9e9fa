#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "core/image.h"
#include "core/result.h"

namespace lightrig {

/// What a frame shows, for whoever meets the file alone.
struct FrameFacts {
  std::string file;  ///< its place in the session folder, "frames/L03/e2.exr"
  std::string role;  ///< as StoredFrame::role
};

/// A frame as EXR bytes (OpenImageIO, one UINT channel "Y", lossless), encoded in memory.
/// Attributes: ExposureTime [s], and under lightrig: exposure_s (in full precision), color_filter,
/// bits, black_level_dn, gain_e_per_dn, frame, role. Nothing that changes from run to run, so equal
/// frames are equal bytes.
Result<std::vector<std::byte>> encode_frame(const Frame& frame, const SensorModel& sensor,
                                            const FrameFacts& facts = {});

/// Reads a frame file back. The frame's id is not in the file: it stands in the sidecar.
Result<Frame> read_frame(const std::filesystem::path& path);

/// A float image (rows · columns · channels, interleaved) as EXR bytes, channels named.
Result<std::vector<std::byte>> encode_float_exr(int width, int height,
                                                const std::vector<std::string>& channels,
                                                const std::vector<float>& pixels);

/// 8-bit sRGB PNG bytes (1, 3 or 4 channels), with the size in which it is to be printed where
/// `pixels_per_m` is above 0.
Result<std::vector<std::byte>> encode_png(int width, int height, int channels,
                                          const std::vector<std::uint8_t>& pixels,
                                          double pixels_per_m = 0);

}  // namespace lightrig
