#pragma once

#include <nlohmann/json.hpp>
#include <string_view>

#include "core/result.h"

namespace lightrig {

/// Levels of lists and objects that a document may nest; ours have less than ten. Copying and
/// writing a document call themselves once a level: a few 100 kB of "[" would end the process.
inline constexpr int deepest_json = 64;

/// The document in a text. Errors: invalid_input, with line and column, where it is no JSON, ends
/// early or nests deeper than deepest_json.
Result<nlohmann::ordered_json> parse_json(std::string_view text);

}  // namespace lightrig
