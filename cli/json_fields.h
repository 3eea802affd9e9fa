#pragma once

#include <cstdint>
#include <limits>
#include <nlohmann/json.hpp>
#include <string>

namespace lightrig::cli {

using Json = nlohmann::ordered_json;

/// A string member, "" where there is none.
inline std::string text(const Json& json, const char* name) {
  const auto found = json.find(name);
  return found != json.end() && found->is_string() ? found->get<std::string>() : "";
}

/// A number member, NaN where there is none (null counts as none).
inline double number(const Json& json, const char* name) {
  const auto found = json.find(name);
  return found != json.end() && found->is_number() ? found->get<double>()
                                                   : std::numeric_limits<double>::quiet_NaN();
}

/// A whole-number member, 0 where there is none.
inline std::int64_t whole(const Json& json, const char* name) {
  const auto found = json.find(name);
  return found != json.end() && found->is_number_integer() ? found->get<std::int64_t>() : 0;
}

/// An object or array member, null where there is none.
inline const Json& part(const Json& json, const char* name) {
  static const Json none;
  const auto found = json.find(name);
  return found != json.end() ? *found : none;
}

}  // namespace lightrig::cli
