#pragma once

#include <optional>
#include <span>
#include <string>
#include <vector>

#include "core/gantry_model.h"
#include "core/result.h"

namespace lightrig {

/// A member of a JSON body, for the OpenAPI document and for checking.
struct BodyField {
  const char* name;
  const char* type;  ///< "string", "number", "boolean", "object"
  bool required;
  const char* description;
};

/// Errors: invalid_input: no JSON object, a member that is not among the fields or not of its type,
/// a required one missing. What reads a body below may take this as given.
Result<void> check_body(const std::string& body, std::span<const BodyField> fields);

/// A string member of a JSON object; empty when the text is none, or has none.
std::optional<std::string> text_member(const std::string& body, const std::string& name);
/// A boolean member, false when absent.
bool flag_member(const std::string& body, const std::string& name);

struct JogBody {
  std::string axis;
  double value = 0;  ///< [rad] or [m]
  bool relative = false;
  std::string key;  ///< "" for none
};
/// Errors: invalid_input: an unknown axis, a unit that is not the axis'.
Result<JogBody> jog_body(const std::string& body, const std::vector<Axis>& axes);

struct LampBody {
  double power = 0;  ///< [0, 1]
  std::string key;   ///< "" for none
};
/// Errors: invalid_input.
Result<LampBody> lamp_body(const std::string& body);

struct SnapBody {
  double exposure = 0;  ///< [s]
  bool lit = false;
  std::string key;  ///< "" for none
};
/// Errors: invalid_input, also for an exposure outside what the sensor takes.
Result<SnapBody> snap_body(const std::string& body, double least, double most);

struct StartBody {
  std::string session_path, session_toml, key;
  std::string plan;  ///< JSON text; "" for none
};
/// Errors: invalid_input.
Result<StartBody> start_body(const std::string& body);

}  // namespace lightrig
