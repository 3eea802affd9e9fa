#pragma once

#include <array>
#include <cstdint>
#include <span>

namespace lightrig::sim {

/// Philox 4x32-10, a counter-based generator [Salmon et al. 2011]: the same (counter, key) gives
/// the same 128 random bits on every machine, in any order, on any thread.
using PhiloxCounter = std::array<std::uint32_t, 4>;
using PhiloxKey = std::array<std::uint32_t, 2>;
PhiloxCounter philox(PhiloxCounter counter, PhiloxKey key);

/// A key that depends on the seed and on every word (Philox used as a keyed mixing function).
PhiloxKey derive_key(std::uint64_t seed, std::span<const std::uint64_t> words);

/// Uniform in (0, 1): 52 bits, never 0 or 1.
double uniform_open(std::uint32_t high, std::uint32_t low);

/// Poisson variate with this mean, exact for every mean ≥ 0: inversion below 10, Hörmann's
/// transformed rejection (PTRS) [Hörmann 1993] above. Draws come from (stream, 1), (stream, 2), …
double poisson(double mean, std::uint32_t stream, PhiloxKey key);

/// Standard normal variate (Box–Muller) from (stream, 0).
double standard_normal(std::uint32_t stream, PhiloxKey key);

}  // namespace lightrig::sim
