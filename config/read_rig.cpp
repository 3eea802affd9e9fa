#include "config/read_rig.h"

#include <fmt/format.h>

#include <algorithm>
#include <limits>

#include "config/calibration_file.h"
#include "config/check_rig.h"
#include "config/descriptions.h"
#include "config/documents.h"
#include "config/section.h"
#include "config/suggest.h"
#include "core/builtin_materials.h"

namespace lightrig {
namespace {

// The profile that a rig names. Its own faults are reported as the rig's; a file that is not there
// is reported where the rig names it.
std::optional<ControllerProfile> profile_of(const Section& root, NamedFiles named,
                                            Findings& findings) {
  const Section* gantry = root.find("gantry");
  const Section* modbus = gantry == nullptr ? nullptr : gantry->find("modbus");
  if (modbus == nullptr || !modbus->has("profile")) return std::nullopt;
  ReadProfile read = read_profile(modbus->file("profile"));
  if (read.value) return read.value;
  if (named == NamedFiles::may_be_absent) return std::nullopt;
  for (Diagnostic& d : read.diagnostics) {
    if (d.line == 0)
      findings.error(modbus->at("profile"),
                     fmt::format("gantry.modbus.profile: \"{}\": {}", d.file.string(), d.message));
    else
      findings.add(std::move(d));
  }
  return std::nullopt;
}

void check_simulated_material(const Section& root, Findings& findings) {
  const Section* simulation = root.find("simulation");
  if (simulation == nullptr || !simulation->has("material")) return;
  const std::string& name = simulation->text("material");
  if (names_a_file(name) || find_builtin(name) != nullptr) return;
  std::vector<std::string> names;
  for (const BuiltinMaterial& m : builtin_materials()) names.push_back(m.name);
  findings.error(simulation->at("material"),
                 fmt::format("simulation.material: the built-in set has no \"{}\" (a file's path "
                             "holds a \"/\" or ends in .binary)",
                             name),
                 did_you_mean(name, names));
}

// The camera's place is stated once: in the rig file, or in its calibration.
void check_calibrated_pose(const Section& camera, bool stated, Findings& findings) {
  const std::string file = camera.file("calibration").string();
  if (!stated && !camera.given_key("eye_m"))
    findings.error(camera.at("calibration"),
                   fmt::format("camera.calibration: \"{}\" does not say where the camera stands, "
                               "and [camera] lacks eye_m: calibrate with --board-origin-m, or "
                               "state eye_m, target_m and up",
                               file));
  for (const char* key : {"eye_m", "target_m", "up"})
    if (stated && camera.given_key(key))
      findings.error(camera.at(key), fmt::format("camera.{} conflicts with calibration (line {}), "
                                                 "which states where the camera stands",
                                                 key, camera.at("calibration").line));
}

// Calibrations that the rig names are read once to see that they can be.
void check_calibrations(const Section& root, Findings& findings) {
  const Section *camera = root.find("camera"), *lamp = root.find("lamp");
  if (camera != nullptr && camera->has("calibration")) {
    CameraConfig trial;
    if (camera->has("width_px")) trial.model.width = camera->integer("width_px");
    if (camera->has("height_px")) trial.model.height = camera->integer("height_px");
    if (auto read = apply_camera_calibration(camera->file("calibration"), trial); read)
      check_calibrated_pose(*camera, *read, findings);
    else
      findings.error(camera->at("calibration"),
                     fmt::format("camera.calibration: \"{}\" {}",
                                 camera->file("calibration").string(), read.error().message));
  }
  if (lamp != nullptr && lamp->has("white_reference") && lamp->has("kind")) {
    LampConfig trial;
    if (auto read = apply_white_reference(lamp->file("white_reference"),
                                          lamp->text("kind") == "near", trial);
        !read)
      findings.error(lamp->at("white_reference"),
                     fmt::format("lamp.white_reference: \"{}\" {}",
                                 lamp->file("white_reference").string(), read.error().message));
  }
}

std::vector<const Section*> pointers(const std::vector<Section>& sections) {
  std::vector<const Section*> all;
  for (const Section& s : sections) all.push_back(&s);
  return all;
}

ExposureRange exposures_of(const Section& root) {
  ExposureRange range;
  const Section* camera = root.find("camera");
  const Section* sensor = camera == nullptr ? nullptr : camera->find("sensor");
  if (sensor == nullptr || !sensor->has("min_exposure_s") || !sensor->has("max_exposure_s"))
    return range;
  const ExposureRange said{sensor->number("min_exposure_s"), sensor->number("max_exposure_s")};
  return said.least < said.most ? said : range;
}

}  // namespace

Read<Rig> read_rig_text(std::string text, const std::filesystem::path& path, NamedFiles named) {
  Read<Rig> read;
  read.text = std::move(text);
  const Source source{path, read.text};
  Findings findings;
  const auto root = read_document(source, rig_description(),
                                  "at least [rig], [camera], [gantry] and [lamp]", findings);
  if (root) {
    const auto profile = profile_of(*root, named, findings);
    check_rig(*root, profile ? &*profile : nullptr, findings);
    check_simulated_material(*root, findings);
    const std::vector<const Section*> tables = pointers(root->sections);
    check_session(tables, exposures_of(*root), findings);
    if (named == NamedFiles::must_exist) {
      check_named_files(tables, findings);
      check_calibrations(*root, findings);
    }
    if (!findings.has_error()) {
      read.value = make_rig(*root, profile ? &*profile : nullptr);
      read.value->session_defaults = make_session(tables);
      read.value->path = path;
      read.value->text = read.text;
    }
  }
  read.diagnostics = findings.sorted();
  return read;
}

Read<Rig> read_rig(const std::filesystem::path& path, NamedFiles named) {
  auto text = read_text(path);
  if (!text) return {std::nullopt, {text.error()}, {}};
  return read_rig_text(std::move(*text), path, named);
}

Read<SessionSpec> read_session_text(std::string text, const std::filesystem::path& path,
                                    const Rig& rig, NamedFiles named) {
  Read<SessionSpec> read;
  read.text = std::move(text);
  const Source source{path, read.text}, rig_source{rig.path, rig.text};
  Findings findings, settled;
  // What there was to say of the rig file was said when it was read.
  const auto rig_root = read_document(rig_source, rig_description(), "", settled);
  std::optional<Section> own;
  if (!path.empty())
    own = read_document(source, session_description(), "at least one table of a session", findings);
  if (rig_root && (path.empty() || own)) {
    const auto tables = effective_tables(own ? &*own : nullptr, *rig_root,
                                         path.empty() ? rig_source : source, findings);
    check_session(tables, {rig.camera.sensor.min_exposure, rig.camera.sensor.max_exposure},
                  findings);
    if (named == NamedFiles::must_exist) check_named_files(tables, findings);
    if (!findings.has_error()) {
      read.value = make_session(tables);
      read.value->path = path;
      read.value->text = read.text;
    }
  }
  read.diagnostics = findings.sorted();
  return read;
}

Read<SessionSpec> read_session(const std::filesystem::path& path, const Rig& rig,
                               NamedFiles named) {
  if (path.empty()) return read_session_text({}, path, rig, named);
  auto text = read_text(path);
  if (!text) return {std::nullopt, {text.error()}, {}};
  return read_session_text(std::move(*text), path, rig, named);
}

}  // namespace lightrig
