#pragma once

#include <optional>
#include <string>
#include <vector>

#include "core/gantry_model.h"
#include "core/result.h"

namespace lightrig {

/// A string member of a JSON object; empty when the text is none, or has none.
std::optional<std::string> text_member(const std::string& body, const std::string& name);
/// A boolean member, false when absent.
bool flag_member(const std::string& body, const std::string& name);

struct JogBody {
  std::string axis;
  double value = 0;  ///< [rad] or [m]
  bool relative = false;
};
/// Errors: invalid_input: no JSON, an unknown member or axis, a unit that is not the axis'.
Result<JogBody> jog_body(const std::string& body, const std::vector<Axis>& axes);

struct StartBody {
  std::string session_path, session_toml, key;
  std::string plan;  ///< JSON text; "" for none
};
/// Errors: invalid_input.
Result<StartBody> start_body(const std::string& body);

}  // namespace lightrig
