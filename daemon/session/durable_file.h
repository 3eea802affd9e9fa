#pragma once

#include <cstddef>
#include <filesystem>
#include <span>
#include <string>

#include "core/result.h"

namespace lightrig {

/// Writes a file whole or not at all: PATH.part, every return checked, fsync, read back and
/// compared, rename, fsync of the directory. Errors: no_space (ENOSPC, EDQUOT), refused (others),
/// and the .part is removed.
Result<void> write_durably(const std::filesystem::path& path, std::span<const std::byte> bytes);
Result<void> write_durably(const std::filesystem::path& path, const std::string& text);

/// Moves a file to another name on the same disk, making the folder it goes to; durable when it
/// returns. Errors: no_space, refused.
Result<void> move_durably(const std::filesystem::path& from, const std::filesystem::path& to);

/// Makes a folder and those above it; durable when it returns. Errors: no_space, refused.
Result<void> make_folder(const std::filesystem::path& folder);

/// Flushes a folder's list of names to disk. Errors: refused.
Result<void> sync_directory(const std::filesystem::path& folder);

/// The whole of a regular file of at most 4 GiB. Errors: not_found, refused, invalid_input (a
/// folder or device, too large).
Result<std::string> read_file(const std::filesystem::path& path);

/// Lower-case hex SHA-256.
std::string sha256_hex(std::span<const std::byte> bytes);
std::string sha256_hex(const std::string& text);

}  // namespace lightrig
