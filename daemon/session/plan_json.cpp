#include "daemon/session/plan_json.h"

#include <fmt/format.h>

#include <array>
#include <cmath>
#include <cstring>
#include <span>
#include <utility>

#include "config/json_text.h"
#include "daemon/session/durable_file.h"
#include "daemon/session/input_hash.h"
#include "daemon/session/json_cursor.h"
#include "daemon/session/json_parse.h"

namespace lightrig {
namespace {

using Json = nlohmann::ordered_json;

constexpr const char* schema = "lightrig.plan/1";

constexpr std::array<std::pair<Criterion, const char*>, 2> criteria{
    {{Criterion::condition, "condition"}, {Criterion::a_optimal, "a-optimal"}}};
constexpr std::array<std::pair<StopRule, const char*>, 3> stop_rules{
    {{StopRule::literal, "literal"}, {StopRule::plateau, "plateau"}, {StopRule::count, "count"}}};

template <class Enum, std::size_t n>
const char* name_in(const std::array<std::pair<Enum, const char*>, n>& names, Enum value) {
  for (const auto& [known, name] : names) {
    if (known == value) return name;
  }
  return "unknown";
}

template <class Enum, std::size_t n>
Enum value_in(const std::array<std::pair<Enum, const char*>, n>& names, const JsonCursor& at) {
  const std::string text = at.text();
  std::string expected;
  for (const auto& [known, name] : names) {
    if (text == name) return known;
    expected += expected.empty() ? name : std::string(", ") + name;
  }
  at.reject("is \"" + text + "\", expected one of " + expected);
  return names.front().first;
}

Json vector_json(const Eigen::Vector3d& v) { return Json::array({v.x(), v.y(), v.z()}); }

Json axes_json(const AxisValues& axes) {
  Json list = Json::array();
  for (const double axis : axes) list.push_back(axis);
  return list;
}

// --- writing

Json light_json(const Shot& shot) {
  const SelectedLight& selected = shot.selection;
  Json light;
  light["candidate"] = shot.candidate;
  light["held_out"] = shot.held_out;
  light["distant"] = shot.light.distant;
  // "direction" is the unit vector from the world's origin; the exact position is position_m, or
  // for a distant lamp the direction itself.
  light["direction"] = vector_json(shot.light.distant || shot.light.p.norm() == 0
                                       ? shot.light.p
                                       : Eigen::Vector3d(shot.light.p.normalized()));
  light["position_m"] = shot.light.distant ? Json() : vector_json(shot.light.p);
  light["gantry_axes"] = axes_json(shot.gantry.axes);
  light["condition"] = selected.condition;
  light["rank"] = selected.rank;
  light["score"] = selected.score;
  light["new_cells"] = selected.new_cells;
  light["predicted_error_percent"] = selected.predicted_error_percent;
  light["exposures_s"] = shot.exposures;
  return light;
}

Json left_out_json(const LeftOut& left_out) {
  const BinningStatistics& b = left_out.binning;
  const SelectionStatistics& s = left_out.selection;
  Json json;
  json["candidates"] = {
      {"offered", left_out.candidates_offered},   {"unreachable", left_out.candidates_unreachable},
      {"kept_out", left_out.candidates_kept_out}, {"touching", left_out.candidates_touching},
      {"in_view", left_out.candidates_in_view},   {"into_lens", left_out.candidates_into_lens},
      {"hiding", left_out.candidates_hiding}};
  json["bins"] = {{"pairs_tested", b.points_tested},
                  {"back_facing", b.back_facing},
                  {"no_half_vector", b.no_half_vector},
                  {"repeated", b.repeated},
                  {"rays_cast", b.rays_cast},
                  {"rays_left_out", b.rays_left_out},
                  {"convex", b.convex}};
  json["selection"] = {{"identical_candidates", s.identical_candidates},
                       {"empty_candidates", s.empty_candidates},
                       {"exact_evaluations", s.exact_evaluations},
                       {"bounded_away", s.bounded_away}};
  json["lights_not_needed"] = left_out.lights_not_needed;
  json["components"] = {{"available", left_out.components_available},
                        {"used", left_out.components_used}};
  json["channels_not_needed"] = left_out.channels_not_needed;
  json["drivers_not_opened"] = left_out.drivers_not_opened;
  return json;
}

Json basis_json(const Prepared& prepared) {
  const BrdfBasis& basis = prepared.plan_basis;
  return {{"source", basis.source},
          {"materials", basis.materials},
          {"layout", basis.layout == ChannelLayout::stacked ? "stacked" : "columns"},
          {"components", basis.components()},
          {"fit_components", prepared.fit_basis.components()},
          {"variance_captured", basis.variance_captured},
          {"model_sigma", basis.model_sigma},
          {"floor", basis.mapping.floor}};
}

// --- reading

Eigen::Vector3d vector_of(const JsonCursor& at) {
  const std::vector<double> v = at.numbers();
  if (v.size() != 3) {
    at.reject(fmt::format("has {} numbers, expected 3", v.size()));
    return Eigen::Vector3d::UnitZ();
  }
  return {v[0], v[1], v[2]};
}

Shot shot_of(const JsonCursor& at) {
  Shot shot;
  shot.candidate = at["candidate"].small_integer();
  if (shot.candidate < 0) at["candidate"].reject("is negative");
  shot.held_out = at["held_out"].boolean();
  shot.light.distant = at["distant"].boolean();
  shot.light.p = vector_of(shot.light.distant ? at["direction"] : at["position_m"]);
  const std::vector<double> axes = at["gantry_axes"].numbers();
  if (axes.empty() || axes.size() > 6) {
    at["gantry_axes"].reject(fmt::format("has {} numbers, expected 1 to 6", axes.size()));
  } else {
    shot.gantry.axes =
        Eigen::Map<const Eigen::VectorXd>(axes.data(), static_cast<Eigen::Index>(axes.size()));
  }
  shot.selection.candidate = shot.candidate;
  shot.selection.condition = at["condition"].number_or_infinity();
  shot.selection.rank = at["rank"].small_integer();
  shot.selection.score = at["score"].number_or_infinity();
  shot.selection.new_cells = at["new_cells"].small_integer();
  shot.selection.predicted_error_percent = at["predicted_error_percent"].number_or_infinity();
  shot.exposures = at["exposures_s"].numbers();
  if (shot.exposures.empty()) at["exposures_s"].reject("is empty");
  for (const double exposure : shot.exposures) {
    if (!(exposure > 0)) at["exposures_s"].reject("holds an exposure that is not positive");
  }
  return shot;
}

LeftOut left_out_of(const JsonCursor& at) {
  LeftOut left_out;
  const JsonCursor candidates = at["candidates"], bins = at["bins"], selection = at["selection"];
  left_out.candidates_offered = candidates["offered"].small_integer();
  left_out.candidates_unreachable = candidates["unreachable"].small_integer();
  left_out.candidates_kept_out = candidates["kept_out"].small_integer();
  // Plans made before these were told apart lack them.
  const auto if_told = [&](const char* key) {
    return candidates.has(key) ? candidates[key].small_integer() : 0;
  };
  left_out.candidates_touching = if_told("touching");
  left_out.candidates_in_view = if_told("in_view");
  left_out.candidates_into_lens = if_told("into_lens");
  left_out.candidates_hiding = if_told("hiding");
  left_out.binning = {.points_tested = bins["pairs_tested"].integer(),
                      .back_facing = bins["back_facing"].integer(),
                      .no_half_vector = bins["no_half_vector"].integer(),
                      .repeated = bins["repeated"].integer(),
                      .rays_cast = bins["rays_cast"].integer(),
                      .rays_left_out = bins["rays_left_out"].integer(),
                      .convex = bins["convex"].boolean()};
  left_out.selection = {.identical_candidates = selection["identical_candidates"].integer(),
                        .exact_evaluations = selection["exact_evaluations"].integer(),
                        .bounded_away = selection["bounded_away"].integer(),
                        .empty_candidates = selection["empty_candidates"].integer()};
  left_out.lights_not_needed = at["lights_not_needed"].small_integer();
  left_out.components_available = at["components"]["available"].small_integer();
  left_out.components_used = at["components"]["used"].small_integer();
  left_out.channels_not_needed = at["channels_not_needed"].small_integer();
  left_out.drivers_not_opened = at["drivers_not_opened"].texts();
  return left_out;
}

PlanInputs inputs_of(const JsonCursor& at) {
  return {at["rig_sha256"].text(),
          at["session_sha256"].is_null() ? std::string() : at["session_sha256"].text(),
          at["mesh_sha256"].text(), at["materials_sha256"].text()};
}

/// The visiting order must name every light once, or a shot would be lost or taken twice.
void check_order(const std::vector<int>& order, std::size_t shots, const JsonCursor& at) {
  std::vector<bool> seen(shots, false);
  for (const int index : order) {
    if (index < 0 || static_cast<std::size_t>(index) >= shots ||
        seen[static_cast<std::size_t>(index)]) {
      at.reject(fmt::format("names light {}, which does not exist or was named before", index));
      return;
    }
    seen[static_cast<std::size_t>(index)] = true;
  }
  if (order.size() != shots) {
    at.reject(fmt::format("names {} of {} lights", order.size(), shots));
  }
}

}  // namespace

std::string plan_to_json(const Rig& rig, const SessionSpec& spec, const Prepared& prepared) {
  const Plan& plan = prepared.plan;
  Json json;
  json["schema"] = schema;
  json["rig"] = rig.name;
  json["criterion"] = name_in(criteria, plan.criterion);
  json["stop"] = {{"rule", name_in(stop_rules, plan.stop)}, {"value", plan.stop_value}};
  json["basis"] = basis_json(prepared);
  json["object"] = prepared.object.description;
  json["points"] = prepared.points.size();
  json["mean_only_error_percent"] = plan.mean_only_error_percent;
  json["lights"] = Json::array();
  for (const Shot& shot : plan.shots) json["lights"].push_back(light_json(shot));
  json["visit_order"] = plan.visit_order;
  json["left_out"] = left_out_json(plan.left_out);
  json["remarks"] = prepared.remarks;
  json["inputs"] = {{"rig_sha256", sha256_hex(rig.text)},
                    {"session_sha256", spec.text.empty() ? Json() : Json(sha256_hex(spec.text))},
                    {"mesh_sha256", mesh_hash(prepared.object.mesh)},
                    {"materials_sha256", materials_hash(prepared.materials)}};
  Json positions = Json::array();
  for (const Candidate& candidate : prepared.candidates) {
    positions.push_back(vector_json(candidate.light.p));
  }
  json["candidates"] = std::move(positions);
  json["unusable"] = Json::array();
  for (const UnusableCandidate& candidate : prepared.unusable)
    json["unusable"].push_back(
        {{"at", vector_json(candidate.light.p)}, {"why", text_of(candidate.why)}});
  Json stages = Json::object();
  double total = 0;
  for (const StageCost& stage : prepared.cost) {
    stages[stage.stage] = stage.seconds;
    total += stage.seconds;
  }
  json["cost"] = {
      {"plan_s", total},
      {"peak_memory_mib", prepared.peak_memory_mib},
      {"predicted_capture_s", plan.predicted_capture_time},
      {"predicted_capture_by_lights_s",
       prepared.capture_by_lights.empty() ? Json(nullptr) : Json(prepared.capture_by_lights)},
      {"stages_s", std::move(stages)}};
  return json_text(json, 1) + "\n";
}

Json replanned_json(const Plan& plan, const std::vector<int>& lights) {
  Json list = Json::array();
  for (const int index : lights) {
    Json light{{"index", index}};
    light.update(light_json(plan.shots[static_cast<std::size_t>(index)]));
    list.push_back(std::move(light));
  }
  return {{"lights", std::move(list)}, {"visit_order", plan.visit_order}};
}

Result<std::string> with_replanned(const std::string& plan, const std::vector<Json>& events) {
  auto json = parse_json(plan);
  if (!json) return tl::unexpected(with_context("read plan.json", json.error()));
  for (const Json& event : events) {
    // Said of the plan as it is, which knows what an event may change.
    auto known = plan_from_json(json_text(*json));
    if (!known) return tl::unexpected(known.error());
    if (auto taken = apply_replanned(event, *known); !taken) return tl::unexpected(taken.error());
    for (const Json& light : event["lights"]) {
      Json& changed = (*json)["lights"][light["index"].get<std::size_t>()];
      changed.update(light);
      changed.erase("index");
    }
    (*json)["visit_order"] = event["visit_order"];
  }
  // Of the plan as it was reviewed, whose lights were others.
  if (!events.empty() && json->contains("cost"))
    (*json)["cost"]["predicted_capture_by_lights_s"] = nullptr;
  return json_text(*json, 1) + "\n";
}

Result<void> apply_replanned(const Json& event, Plan& plan) {
  std::string problem;
  const JsonCursor root(event, problem);
  for (const JsonCursor& light : root["lights"].items()) {
    const int index = light["index"].small_integer();
    if (index < 0 || static_cast<std::size_t>(index) >= plan.shots.size()) {
      light["index"].reject(fmt::format("is not one of {} lights", plan.shots.size()));
      continue;
    }
    plan.shots[static_cast<std::size_t>(index)] = shot_of(light);
  }
  plan.visit_order.clear();
  for (const JsonCursor& index : root["visit_order"].items()) {
    plan.visit_order.push_back(index.small_integer());
  }
  check_order(plan.visit_order, plan.shots.size(), root["visit_order"]);
  if (!problem.empty()) return fail(ErrorCode::invalid_input, problem);
  return {};
}

Result<void> check_made_for(const Plan& plan, const Prepared& prepared) {
  std::string other;
  if (plan.inputs.mesh != mesh_hash(prepared.object.mesh)) other = "another object";
  if (plan.inputs.materials != materials_hash(prepared.materials)) {
    other += other.empty() ? "other materials" : " and other materials";
  }
  if (other.empty()) return {};
  return fail(ErrorCode::invalid_input,
              fmt::format("use the given plan: it was made for {}, and would light what it does "
                          "not know; plan again with this rig and session file",
                          other));
}

Result<Plan> plan_from_json(const std::string& text, const std::string& name) {
  const auto json = parse_json(text);
  if (!json) {
    return fail(ErrorCode::invalid_input,
                fmt::format("read {}: {}; plan again", name, json.error().message));
  }
  std::string problem;
  const JsonCursor root(*json, problem);
  if (root["schema"].text() != schema) root["schema"].reject(fmt::format("is not {}", schema));
  Plan plan;
  plan.criterion = value_in(criteria, root["criterion"]);
  plan.stop = value_in(stop_rules, root["stop"]["rule"]);
  plan.stop_value = root["stop"]["value"].number();
  plan.mean_only_error_percent = root["mean_only_error_percent"].number_or_infinity();
  for (const JsonCursor& light : root["lights"].items()) plan.shots.push_back(shot_of(light));
  if (plan.shots.empty()) root["lights"].reject("is empty");
  const std::size_t candidates = root["candidates"].items().size();
  for (const Shot& shot : plan.shots) {
    if (static_cast<std::size_t>(shot.candidate) >= candidates) {
      root["lights"].reject(fmt::format("names candidate {} of {}", shot.candidate, candidates));
    }
  }
  for (const JsonCursor& index : root["visit_order"].items()) {
    plan.visit_order.push_back(index.small_integer());
  }
  check_order(plan.visit_order, plan.shots.size(), root["visit_order"]);
  plan.left_out = left_out_of(root["left_out"]);
  plan.predicted_capture_time = root["cost"]["predicted_capture_s"].number();
  plan.inputs = inputs_of(root["inputs"]);
  if (!problem.empty()) {
    return fail(ErrorCode::invalid_input, fmt::format("read {}: {}; plan again", name, problem));
  }
  return plan;
}

}  // namespace lightrig
