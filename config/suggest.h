#pragma once

#include <span>
#include <string>
#include <string_view>

namespace lightrig {

/// Least number of insertions, deletions, replacements and swaps of neighbours that turn a into b
/// (optimal string alignment), case ignored.
int edit_distance(std::string_view a, std::string_view b);

/// The nearest of the names, or "" when none is near (see did_you_mean).
std::string nearest(std::string_view wrong, std::span<const std::string> names);

/// `did you mean "…"?` with the nearest of the names, or "" when none is near: more than a third of
/// the letters differ, and neither begins with the other.
std::string did_you_mean(std::string_view wrong, std::span<const std::string> names);

}  // namespace lightrig
