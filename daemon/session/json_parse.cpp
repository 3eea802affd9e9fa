#include "daemon/session/json_parse.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <string>

namespace lightrig {
namespace {

using Json = nlohmann::ordered_json;

/// "line 3, column 7" of a byte, both counted from 1.
std::string place_of(std::string_view text, std::size_t byte) {
  const std::string_view before = text.substr(0, std::min(byte, text.size()));
  const auto line = std::count(before.begin(), before.end(), '\n') + 1;
  const std::size_t newline = before.rfind('\n');
  const std::size_t column =
      newline == std::string_view::npos ? before.size() + 1 : before.size() - newline;
  return fmt::format("line {}, column {}", line, column);
}

struct Excess {
  std::size_t at = std::string_view::npos;
  std::string what;
};

/// The first byte that opens one level, or begins one member, too many; npos when none does.
Excess excess_of(std::string_view text) {
  int depth = 0;
  std::array<int, deepest_json + 1> members{};  // so far, of what is open at each level
  bool quoted = false;
  for (std::size_t i = 0; i < text.size(); ++i) {
    const char c = text[i];
    if (quoted) {
      if (c == '\\') ++i;
      if (c == '"') quoted = false;
    } else if (c == '"') {
      quoted = true;
    } else if (c == '[' || c == '{') {
      if (++depth > deepest_json)
        return {i, fmt::format("nests deeper than {} levels", deepest_json)};
      if (depth >= 0) members[static_cast<std::size_t>(depth)] = 0;
    } else if (c == ']' || c == '}') {
      --depth;
    } else if (c == ':' && depth >= 0) {
      if (++members[static_cast<std::size_t>(depth)] > most_members)
        return {i, fmt::format("has more than {} members in one object", most_members)};
    }
  }
  return {};
}

}  // namespace

Result<Json> parse_json(std::string_view text) {
  if (const Excess excess = excess_of(text); excess.at != std::string_view::npos) {
    return fail(ErrorCode::invalid_input,
                fmt::format("it {} at {}", excess.what, place_of(text, excess.at)));
  }
  try {
    return Json::parse(text);
  } catch (const Json::parse_error& error) {
    const std::size_t at = error.byte > 0 ? error.byte - 1 : 0;
    return fail(ErrorCode::invalid_input,
                at >= text.size() ? std::string("it is not JSON, or was cut short")
                                  : fmt::format("it is not JSON at {}", place_of(text, at)));
  } catch (const Json::exception&) {
    return fail(ErrorCode::invalid_input, "it holds a number that no double can");
  }
}

}  // namespace lightrig
