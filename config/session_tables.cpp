#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <system_error>

#include "config/check_rig.h"
#include "config/suggest.h"
#include "core/builtin_materials.h"
#include "core/check.h"

namespace lightrig {
namespace {

namespace fs = std::filesystem;

const Section* table_named(std::span<const Section* const> tables, const char* name) {
  const auto at =
      std::ranges::find_if(tables, [&](const Section* s) { return s->spec->name == name; });
  return at == tables.end() ? nullptr : *at;
}

void check_bracket(const Section& s, const ExposureRange& camera, Findings& findings) {
  if (!s.has("exposures_s")) return;
  const std::vector<double> exposures = s.numbers("exposures_s");
  for (std::size_t i = 0; i < exposures.size(); ++i) {
    if (i > 0 && exposures[i] <= exposures[i - 1])
      findings.error(s.at("exposures_s", i),
                     fmt::format("bracket.exposures_s[{}] is {} s; each exposure must be longer "
                                 "than the one before it, {} s",
                                 i + 1, exposures[i], exposures[i - 1]));
    if (exposures[i] < camera.least || exposures[i] > camera.most)
      findings.error(s.at("exposures_s", i),
                     fmt::format("bracket.exposures_s[{}] is {} s; the camera can take {} … {} s",
                                 i + 1, exposures[i], camera.least, camera.most));
  }
}

void check_plan(const Section& plan, const Section* stop, const Section* materials,
                Findings& findings) {
  if (stop != nullptr && stop->has("lights") && plan.has("max_lights") &&
      stop->integer("lights") > plan.integer("max_lights"))
    findings.warning(stop->at("lights"),
                     fmt::format("stop.lights is {}, but plan.max_lights is {}: it never applies",
                                 stop->integer("lights"), plan.integer("max_lights")));
  const bool pseudo_inverse = plan.has("estimator") && plan.text("estimator") == "pseudo-inverse";
  if (pseudo_inverse && materials != nullptr && materials->has("components") &&
      materials->integer("components") == 0)
    findings.warning(plan.at("estimator"),
                     "the pseudo-inverse has no prior: with all components it is badly "
                     "conditioned; set materials.components (the paper: 45)");
}

template <class T>
void check_known(const Section& s, const std::string& key, const std::vector<T>& known,
                 const char* what, Findings& findings) {
  if (!s.has(key)) return;
  const std::vector<std::string>& names = s.texts(key);
  for (std::size_t i = 0; i < names.size(); ++i)
    if (std::ranges::find(known, names[i]) == known.end())
      findings.error(s.at(key, i), fmt::format("the built-in set has no {} \"{}\"", what, names[i]),
                     did_you_mean(names[i], known));
}

void check_materials(const Section& s, Findings& findings) {
  if (!s.has("source")) return;
  if (s.text("source") != "builtin") {
    if (s.given_key("leave_out_families"))
      findings.error(s.at("leave_out_families"),
                     "only the built-in set has families; name the materials in leave_out");
    return;
  }
  std::vector<std::string> names, families;
  for (const BuiltinMaterial& m : builtin_materials()) {
    names.push_back(m.name);
    if (std::ranges::find(families, m.family) == families.end()) families.push_back(m.family);
  }
  check_known(s, "leave_out", names, "material", findings);
  check_known(s, "leave_out_families", families, "family", findings);
}

enum class Wanted : std::uint8_t { file, folder };

void check_exists(const Section& s, const std::string& key, Wanted wanted, Findings& findings) {
  const fs::path path = s.file(key);
  std::error_code error;
  const fs::file_status status = fs::status(path, error);
  const std::string what = fmt::format("{}.{}: ", s.path, key);
  if (!fs::exists(status))
    findings.error(s.at(key), fmt::format("{}there is no \"{}\"", what, path.string()));
  else if (wanted == Wanted::folder && !fs::is_directory(status))
    findings.error(s.at(key), fmt::format("{}\"{}\" is not a folder", what, path.string()));
  else if (wanted == Wanted::file && fs::is_directory(status))
    findings.error(s.at(key), fmt::format("{}\"{}\" is a folder", what, path.string()));
}

ObjectConfig make_object(const Section& s) {
  ObjectConfig o;
  if (s.given_key("shape")) {
    o.shape = s.text("shape");
    o.size = s.number("size_m");
    o.fineness = s.integer("fineness");
  } else {
    o.mesh = s.file("mesh");
    o.unit = s.number("unit_m");
  }
  const Eigen::Vector3d turn = s.vector3("rotation_deg");
  o.world_from_object = Eigen::Translation3d(s.vector3("position_m")) *
                        Eigen::AngleAxisd(turn.z(), Eigen::Vector3d::UnitZ()) *
                        Eigen::AngleAxisd(turn.y(), Eigen::Vector3d::UnitY()) *
                        Eigen::AngleAxisd(turn.x(), Eigen::Vector3d::UnitX());
  return o;
}

MaterialsConfig make_materials(const Section& s) {
  MaterialsConfig m;
  m.source = s.text("source") == "builtin" ? "builtin" : s.file("source").string();
  if (s.has("leave_out_families")) m.leave_out_families = s.texts("leave_out_families");
  if (s.has("leave_out")) m.leave_out = s.texts("leave_out");
  m.components = s.integer("components");
  m.layout = s.text("layout") == "stacked" ? ChannelLayout::stacked : ChannelLayout::columns;
  const std::string& mapping = s.text("mapping");
  m.mapping = mapping == "ln-floor"    ? Mapping::ln_floor
              : mapping == "ln-offset" ? Mapping::ln_offset
                                       : Mapping::log_relative;
  m.floor = s.number("floor_per_sr");
  return m;
}

PlanConfig make_plan(const Section& s) {
  PlanConfig p;
  p.criterion = s.text("criterion") == "condition" ? Criterion::condition : Criterion::a_optimal;
  const std::string& stop = s.text("stop");
  p.stop = stop == "literal"   ? StopRule::literal
           : stop == "plateau" ? StopRule::plateau
                               : StopRule::count;
  p.plateau = s.number("plateau_percent") / 100;
  p.max_lights = s.integer("max_lights");
  p.points = s.text("points") == "pixels" ? PointSource::pixels : PointSource::vertices;
  p.pixel_stride = s.integer("pixel_stride");
  const std::string& shadows = s.text("shadows");
  p.shadows = shadows == "none"     ? ShadowRays::none
              : shadows == "needed" ? ShadowRays::needed
                                    : ShadowRays::all;
  // 90° leaves nothing out; cos 90° in floating point would be 6e-17 and drop exact grazing rows.
  const auto cosine = [&](const char* key) {
    return s.number(key) >= 90 * units::degree ? 0.0 : std::cos(s.number(key));
  };
  p.limits.max_theta_d = s.number("max_theta_d_deg");
  p.limits.min_cos_i = cosine("max_theta_i_deg");
  p.limits.min_cos_o = cosine("max_theta_o_deg");
  p.held_out_lights = s.integer("held_out_lights");
  p.replan = s.boolean("replan");
  p.random_baseline = s.boolean("random_baseline");
  p.seed = s.seed("seed");
  return p;
}

StopConfig make_stop(const Section& s) {
  StopConfig stop;
  if (s.has("predicted_error_percent"))
    stop.predicted_error_percent = s.number("predicted_error_percent");
  if (s.has("minutes")) stop.minutes = s.number("minutes");
  if (s.has("lights")) stop.lights = s.integer("lights");
  return stop;
}

}  // namespace

void check_session(std::span<const Section* const> tables, const ExposureRange& camera,
                   Findings& findings) {
  const Section* materials = table_named(tables, "materials");
  if (materials != nullptr) check_materials(*materials, findings);
  if (const Section* bracket = table_named(tables, "bracket"))
    check_bracket(*bracket, camera, findings);
  if (const Section* plan = table_named(tables, "plan"))
    check_plan(*plan, table_named(tables, "stop"), materials, findings);
}

void check_named_files(std::span<const Section* const> tables, Findings& findings) {
  for (const Section* s : tables) {
    if (s->spec->name == "object" && s->given_key("mesh") && s->has("mesh"))
      check_exists(*s, "mesh", Wanted::file, findings);
    if (s->spec->name == "materials" && s->has("source") && s->text("source") != "builtin")
      check_exists(*s, "source", Wanted::folder, findings);
    if (s->spec->name == "session" && s->has("reference"))
      check_exists(*s, "reference", Wanted::file, findings);
    if (s->spec->name == "simulation" && s->has("material") && names_a_file(s->text("material")))
      check_exists(*s, "material", Wanted::file, findings);
  }
}

SessionSpec make_session(std::span<const Section* const> tables) {
  SessionSpec spec;
  for (const Section* s : tables) {
    const std::string& name = s->spec->name;
    if (name == "object") spec.object = make_object(*s);
    if (name == "materials") spec.materials = make_materials(*s);
    if (name == "stop") spec.stop = make_stop(*s);
    if (name == "plan") {
      spec.plan = make_plan(*s);
      spec.estimator = s->text("estimator") == "map" ? Estimator::map : Estimator::pseudo_inverse;
    }
    if (name == "bracket") {
      spec.bracket.exposures = s->numbers("exposures_s");
      spec.bracket.target_snr = s->number("target_snr");
      spec.bracket.metering = s->boolean("metering");
    }
    if (name == "session") {
      spec.sample_id = s->text("sample_id");
      spec.operator_name = s->text("operator");
      spec.notes = s->text("notes");
      if (s->has("reference")) spec.reference = s->file("reference");
    }
  }
  return spec;
}

}  // namespace lightrig
