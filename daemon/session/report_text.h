#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

namespace lightrig {

// Numbers as the report says them.

/// "4.2 %", "12 %", "–" for what is not finite.
std::string percent(double value);

/// Thin spaces between groups of three, as SI writes numbers.
std::string counted(std::int64_t value);

/// "20 µs, 1.28 ms, 2 s", "none".
std::string exposures_text(const std::vector<double>& exposures);

/// "4.2 s", "3 min 12 s", "1 h 05 min".
std::string spoken_duration(double seconds);

/// Base 64 [RFC 4648].
std::string base64(const std::vector<std::byte>& bytes);

}  // namespace lightrig
