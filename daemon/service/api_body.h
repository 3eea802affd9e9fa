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

/// The lamp's power [0, 1]. Errors: invalid_input.
Result<double> lamp_body(const std::string& body);

struct SnapBody {
  double exposure = 0;  ///< [s]
  bool lit = false;
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
