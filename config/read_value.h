#pragma once

#include <optional>

#include "config/section.h"

namespace lightrig {

/// The value of one key, if the node has the type, range and unit the description asks for; what is
/// wrong goes to `findings`. `full_name` is "gantry.radius_m". Items' places are kept for lists.
std::optional<Value> read_value(const TomlNode& node, const KeySpec& key,
                                const std::string& full_name, Findings& findings);

/// The default of a key; the description's promise that it parses is checked.
Value default_value(const KeySpec& key);

}  // namespace lightrig
