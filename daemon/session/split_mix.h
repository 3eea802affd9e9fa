#pragma once

#include <cstdint>

namespace lightrig {

inline constexpr std::uint64_t split_mix_step = 0x9E3779B97F4A7C15U;

/// A well-mixed 64-bit number from a counter [Steele 2014]: small, and the same on every machine,
/// as the standard's distributions are not.
inline std::uint64_t split_mix(std::uint64_t x) {
  x += split_mix_step;
  x = (x ^ (x >> 30U)) * 0xBF58476D1CE4E5B9U;
  x = (x ^ (x >> 27U)) * 0x94D049BB133111EBU;
  return x ^ (x >> 31U);
}

}  // namespace lightrig
