#include "daemon/service/api_body.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <nlohmann/json.hpp>
#include <numbers>
#include <string_view>

#include "config/json_text.h"
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

Result<Json> read_object(const std::string& body) {
  Result<Json> json = Json::object();
  if (!body.empty()) json = parse_json(body);
  if (!json) return tl::unexpected(with_context("read the body", json.error()));
  if (!json->is_object()) return fail(ErrorCode::invalid_input, "the body must be a JSON object");
  return json;
}

bool is_of_type(const Json& value, std::string_view type) {
  return (type == "string" && value.is_string()) || (type == "number" && value.is_number()) ||
         (type == "boolean" && value.is_boolean()) || (type == "object" && value.is_object());
}

Result<std::string> string_of(const Json& json, const char* name) {
  const auto found = json.find(name);
  if (found == json.end()) return std::string();
  if (!found->is_string())
    return fail(ErrorCode::invalid_input, fmt::format("\"{}\" must be a string", name));
  return found->get<std::string>();
}

}  // namespace

Result<void> check_body(const std::string& body, std::span<const BodyField> fields) {
  const auto json = read_object(body);
  if (!json) return tl::unexpected(json.error());
  for (const auto& [name, value] : json->items()) {
    const auto field = std::ranges::find(fields, std::string_view(name), [](const BodyField& f) {
      return std::string_view(f.name);
    });
    if (field == fields.end()) {
      std::string known;
      for (const BodyField& f : fields) known += (known.empty() ? "" : ", ") + std::string(f.name);
      return fail(ErrorCode::invalid_input,
                  fmt::format("unknown member \"{}\"; {}", name,
                              known.empty() ? "this request takes none" : "there are " + known));
    }
    if (!is_of_type(value, field->type))
      return fail(ErrorCode::invalid_input, fmt::format("\"{}\" must be a {}", name, field->type));
  }
  for (const BodyField& field : fields)
    if (field.required && !json->contains(field.name))
      return fail(ErrorCode::invalid_input,
                  fmt::format("\"{}\" is missing: {}", field.name, field.description));
  return {};
}

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
    std::string_view unit;
    bool relative;
  };
  constexpr std::array<Unit, 6> units{{{"by_deg", "deg", true},
                                       {"to_deg", "deg", false},
                                       {"by_mm", "mm", true},
                                       {"to_mm", "mm", false},
                                       {"by", "", true},
                                       {"to", "", false}}};
  auto json = read_object(body);
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
  const AxisUnit unit = unit_of(*axis);
  if (count != 1 || given->unit != unit.name || !(*json)[given->name].is_number())
    return fail(
        ErrorCode::invalid_input,
        fmt::format("jog: axis {} takes exactly one number, {}", axis->name,
                    unit.name.empty() ? "by or to" : fmt::format("by_{0} or to_{0}", unit.name)));
  auto key = string_of(*json, "key");
  if (!key) return tl::unexpected(with_context("jog", key.error()));
  return JogBody{axis->name, (*json)[given->name].get<double>() / unit.per_si, given->relative,
                 *key};
}

Result<LampBody> lamp_body(const std::string& body) {
  auto json = read_object(body);
  if (!json) return tl::unexpected(with_context("lamp", json.error()));
  const auto power = json->find("power");
  if (power == json->end() || !power->is_number() || !(power->get<double>() >= 0) ||
      !(power->get<double>() <= 1))
    return fail(ErrorCode::invalid_input, "lamp: \"power\" must be a number from 0 to 1");
  auto key = string_of(*json, "key");
  if (!key) return tl::unexpected(with_context("lamp", key.error()));
  return LampBody{power->get<double>(), *key};
}

Result<SnapBody> snap_body(const std::string& body, double least, double most) {
  auto json = read_object(body);
  if (!json) return tl::unexpected(with_context("snap", json.error()));
  const auto exposure = json->find("exposure_s");
  if (exposure == json->end() || !exposure->is_number() || !(exposure->get<double>() >= least) ||
      !(exposure->get<double>() <= most))
    return fail(ErrorCode::invalid_input,
                fmt::format("snap: \"exposure_s\" must be a number from {} to {}", least, most));
  auto key = string_of(*json, "key");
  if (!key) return tl::unexpected(with_context("snap", key.error()));
  return SnapBody{exposure->get<double>(), flag_member(body, "lamp"), *key};
}

Result<StartBody> start_body(const std::string& body) {
  auto json = read_object(body);
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
    start.plan = json_text((*json)["plan"]);
  }
  return start;
}

}  // namespace lightrig
