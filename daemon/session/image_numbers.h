#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "core/result.h"

namespace lightrig {

/// An image file's samples as numbers, whatever its format: for comparing two files that differ in
/// bytes.
struct ImageNumbers {
  int width = 0, height = 0;
  std::vector<std::string> channels;  ///< sorted by name, as EXR stores them
  std::vector<float> values;          ///< (height · width · channels); 8-bit files: 0 … 1
};

/// Errors: not_found, invalid_input.
Result<ImageNumbers> read_image_numbers(const std::filesystem::path& path);

}  // namespace lightrig
