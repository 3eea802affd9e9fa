#pragma once

#include <cstdint>

namespace lightrig::sim {

/// Kinds of randomness of the laboratory, so that no two share a key.
constexpr std::uint64_t noise_of_frame = 1, error_of_lamp = 2;

}  // namespace lightrig::sim
