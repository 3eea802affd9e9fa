#pragma once

#include <nlohmann/json.hpp>
#include <string_view>

#include "core/result.h"

namespace lightrig {

/// Levels of lists and objects that a document may nest; ours have less than ten. Copying and
/// writing a document call themselves once a level: a few 100 kB of "[" would end the process.
inline constexpr int deepest_json = 64;

/// Members that one object may have; ours have less than fifty. They are kept in order and found
/// one by one, so that some MB of short names would take minutes.
inline constexpr int most_members = 1024;

/// The document in a text. Errors: invalid_input, with line and column, where it is no JSON, ends
/// early, nests deeper than deepest_json or has an object of more than most_members.
Result<nlohmann::ordered_json> parse_json(std::string_view text);

}  // namespace lightrig
