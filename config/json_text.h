#pragma once

#include <nlohmann/json.hpp>
#include <string>

namespace lightrig {

/// JSON as text; `indent` −1 is one line. Text that came from a device, a file's name or a client
/// need not be UTF-8: such bytes become U+FFFD, and nothing throws.
template <class Json>
std::string json_text(const Json& json, int indent = -1) {
  return json.dump(indent, ' ', false, Json::error_handler_t::replace);
}

}  // namespace lightrig
