#include "daemon/service/api_body.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <nlohmann/json.hpp>
#include <numbers>
#include <string_view>

#include "daemon/session/json_parse.h"

namespace lightrig {
namespace {

using Json = nlohmann::ordered_json;

// An object, or nothing; an empty body is an empty object.
std::optional<Json> object_of(const std::string& body) {
  if (body.empty()) return Json::object();
  auto json = parse_json(body);
  if (!json || !json->is_object()) return {};
  return std::move(*json);
}

Result<Json> known_object(const std::string& body, std::initializer_list<std::string_view> known) {
  Result<Json> json = Json::object();
  if (!body.empty()) json = parse_json(body);
  if (!json) return tl::unexpected(with_context("read the body", json.error()));
  if (!json->is_object()) return fail(ErrorCode::invalid_input, "the body must be a JSON object");
  for (const auto& [name, unused] : json->items())
    if (std::find(known.begin(), known.end(), name) == known.end())
      return fail(ErrorCode::invalid_input,
                  fmt::format("unknown member \"{}\"; there are {}", name,
                              fmt::join(known.begin(), known.end(), ", ")));
  return json;
}

Result<std::string> string_of(const Json& json, const char* name) {
  const auto found = json.find(name);
  if (found == json.end()) return std::string();
  if (!found->is_string())
    return fail(ErrorCode::invalid_input, fmt::format("\"{}\" must be a string", name));
  return found->get<std::string>();
}

}  // namespace

std::optional<std::string> text_member(const std::string& body, const std::string& name) {
  const auto json = object_of(body);
  if (!json) return {};
  const auto found = json->find(name);
  if (found == json->end() || !found->is_string()) return {};
  return found->get<std::string>();
}

bool flag_member(const std::string& body, const std::string& name) {
  const auto json = object_of(body);
  if (!json) return false;
  const auto found = json->find(name);
  return found != json->end() && found->is_boolean() && found->get<bool>();
}

Result<JogBody> jog_body(const std::string& body, const std::vector<Axis>& axes) {
  struct Unit {
    const char* name;
    bool rotary, relative;
  };
  constexpr std::array<Unit, 4> units{{{"by_deg", true, true},
                                       {"to_deg", true, false},
                                       {"by_mm", false, true},
                                       {"to_mm", false, false}}};
  auto json = known_object(body, {"axis", "by_deg", "to_deg", "by_mm", "to_mm"});
  if (!json) return tl::unexpected(with_context("jog", json.error()));
  auto axis_name = string_of(*json, "axis");
  if (!axis_name) return tl::unexpected(with_context("jog", axis_name.error()));
  const auto axis = std::find_if(axes.begin(), axes.end(),
                                 [&](const Axis& one) { return one.name == *axis_name; });
  if (axis == axes.end()) {
    std::string known;
    for (const Axis& one : axes) known += (known.empty() ? "" : ", ") + one.name;
    return fail(ErrorCode::invalid_input,
                fmt::format("jog: the rig has no axis \"{}\"; it has {}", *axis_name, known));
  }
  const Unit* given = nullptr;
  int count = 0;
  for (const Unit& unit : units)
    if (json->contains(unit.name)) given = &unit, ++count;
  if (count != 1 || given->rotary != axis->rotary || !(*json)[given->name].is_number())
    return fail(ErrorCode::invalid_input,
                fmt::format("jog: axis {} takes exactly one number, {}", axis->name,
                            axis->rotary ? "by_deg or to_deg" : "by_mm or to_mm"));
  // Of fixed lamps the number counts; it comes as if it were millimetres.
  const double scale = axis->selector ? 1 : axis->rotary ? std::numbers::pi / 180 : 1e-3;
  return JogBody{axis->name, (*json)[given->name].get<double>() * scale, given->relative};
}

Result<double> lamp_body(const std::string& body) {
  auto json = known_object(body, {"power"});
  if (!json) return tl::unexpected(with_context("lamp", json.error()));
  const auto power = json->find("power");
  if (power == json->end() || !power->is_number() || !(power->get<double>() >= 0) ||
      !(power->get<double>() <= 1))
    return fail(ErrorCode::invalid_input, "lamp: \"power\" must be a number from 0 to 1");
  return power->get<double>();
}

Result<SnapBody> snap_body(const std::string& body, double least, double most) {
  auto json = known_object(body, {"exposure_s", "lamp"});
  if (!json) return tl::unexpected(with_context("snap", json.error()));
  const auto exposure = json->find("exposure_s");
  if (exposure == json->end() || !exposure->is_number() || !(exposure->get<double>() >= least) ||
      !(exposure->get<double>() <= most))
    return fail(ErrorCode::invalid_input,
                fmt::format("snap: \"exposure_s\" must be a number from {} to {}", least, most));
  return SnapBody{exposure->get<double>(), flag_member(body, "lamp")};
}

Result<StartBody> start_body(const std::string& body) {
  auto json = known_object(body, {"session_path", "session_toml", "plan", "key"});
  if (!json) return tl::unexpected(with_context("start", json.error()));
  StartBody start;
  for (const auto& [name, target] :
       {std::pair{"session_path", &start.session_path},
        std::pair{"session_toml", &start.session_toml}, std::pair{"key", &start.key}}) {
    auto text = string_of(*json, name);
    if (!text) return tl::unexpected(with_context("start", text.error()));
    *target = *text;
  }
  if (!start.session_path.empty() && !start.session_toml.empty())
    return fail(ErrorCode::invalid_input, "start: give session_path or session_toml, not both");
  if (json->contains("plan")) {
    if (!(*json)["plan"].is_object())
      return fail(ErrorCode::invalid_input, "start: \"plan\" must be the object of a plan.json");
    start.plan = (*json)["plan"].dump(-1, ' ', false, Json::error_handler_t::replace);
  }
  return start;
}

}  // namespace lightrig
