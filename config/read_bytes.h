#pragma once

#include <cstddef>
#include <filesystem>
#include <string>
#include <vector>

#include "core/result.h"

namespace lightrig {

/// The bytes of a regular file of at most 4 GiB. Errors: not_found, invalid_input (a directory or
/// device, too large), refused (permission, read error); the message holds the reason, not the
/// path.
Result<std::vector<std::byte>> read_bytes(const std::filesystem::path& file);

/// The same bytes as a string.
Result<std::string> read_byte_string(const std::filesystem::path& file);

}  // namespace lightrig
