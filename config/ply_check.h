#pragma once

#include <cstddef>
#include <optional>
#include <span>
#include <string>

namespace lightrig {

/// Why a PLY file does not hold what its header promises, or nothing. Importers believe the header:
/// what is cut off becomes zeros. Every element is walked, binary (either byte order) or ASCII.
std::optional<std::string> ply_shortfall(std::span<const std::byte> bytes);

}  // namespace lightrig
