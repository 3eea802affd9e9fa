#pragma once

#include <cstdint>
#include <optional>
#include <string>

#include "config/section.h"

namespace lightrig {

/// What no key of a controller profile can say alone: that a move carries a position, a block has
/// no gap, a constant fits its register, a mask can match, a move's end can be told at all.
void check_profile(const Section& root, Findings& findings);

/// "0x30" or "48" as a number.
std::optional<std::int64_t> alarm_number(const std::string& code);

}  // namespace lightrig
