#include "daemon/session/input_files.h"

#include <fmt/format.h>

#include <system_error>

#include "config/calibration_file.h"
#include "core/brdf_table.h"
#include "daemon/session/durable_file.h"

namespace lightrig {
namespace {

namespace fs = std::filesystem;

Result<InputFile> store(const SessionFolder& folder, const std::string& role, const fs::path& from,
                        const std::string& name, std::span<const std::byte> bytes) {
  InputFile input{role, fmt::format("inputs/{}/{}", role, name), from.string(), sha256_hex(bytes)};
  const fs::path path = folder.root / input.file;
  if (auto made = make_folder(path.parent_path()); !made) return tl::unexpected(made.error());
  if (auto written = write_durably(path, bytes); !written) return tl::unexpected(written.error());
  return input;
}

Result<InputFile> copy(const SessionFolder& folder, const std::string& role, const fs::path& from) {
  const auto text = read_file(from);
  if (!text) return tl::unexpected(text.error());
  return store(folder, role, from, from.filename().string(), std::as_bytes(std::span(*text)));
}

}  // namespace

Result<std::vector<InputFile>> copy_inputs(const SessionFolder& folder, const Rig& rig,
                                           const SessionSpec& spec,
                                           const std::vector<Material>& materials) {
  std::vector<std::pair<std::string, fs::path>> named;
  if (!spec.object.mesh.empty()) named.emplace_back("mesh", spec.object.mesh);
  if (!spec.reference.empty()) named.emplace_back("reference", spec.reference);
  if (!rig.camera.calibration.empty()) named.emplace_back("calibration", rig.camera.calibration);
  if (!rig.lamp.white_reference.empty()) named.emplace_back("white", rig.lamp.white_reference);
  if (const auto* modbus = std::get_if<ModbusGantry>(&rig.gantry.backend)) {
    named.emplace_back("profile", modbus->profile);
  }
  std::error_code ignored;
  if (rig.simulation && fs::is_regular_file(rig.simulation->material, ignored)) {
    named.emplace_back("truth", rig.simulation->material);
  }
  std::vector<InputFile> inputs;
  for (const auto& [role, path] : named) {
    auto input = copy(folder, role, path);
    if (!input) return tl::unexpected(with_context("keep a copy of the " + role, input.error()));
    inputs.push_back(std::move(*input));
  }
  if (spec.materials.source == "builtin") return inputs;
  for (const Material& material : materials) {
    const auto bytes = encode_merl(to_merl(material.table, 1));
    auto input = store(folder, "material", fs::path(spec.materials.source) / material.name,
                       material.name + ".binary", bytes);
    if (!input) return tl::unexpected(with_context("keep a copy of a material", input.error()));
    inputs.push_back(std::move(*input));
  }
  return inputs;
}

Result<void> use_inputs(const SessionFolder& folder, const std::vector<InputFile>& inputs, Rig& rig,
                        SessionSpec& spec) {
  for (const InputFile& input : inputs) {
    if (!stays_inside(input.file))
      return fail(ErrorCode::invalid_input,
                  fmt::format("read session '{}': the input file '{}' leads out of the folder",
                              folder.root.string(), input.file));
    const fs::path path = folder.root / input.file;
    const auto text = read_file(path);
    if (!text || sha256_hex(*text) != input.sha256) {
      return fail(ErrorCode::invalid_input,
                  fmt::format("read session '{}': {} {}; it was a copy of '{}': restore it from "
                              "there or from a backup",
                              folder.root.string(), input.file,
                              text ? "is not what was stored" : "is missing", input.from));
    }
    if (input.role == "mesh") {
      spec.object.mesh = path;
    } else if (input.role == "reference") {
      spec.reference = path;
    } else if (input.role == "calibration") {
      if (auto applied = apply_camera_calibration(path, rig.camera); !applied)
        return tl::unexpected(with_context(input.file, applied.error()));
    } else if (input.role == "white") {
      const bool near = !rig.gantry.model.distant_lamp;
      if (auto applied = apply_white_reference(path, near, rig.lamp); !applied)
        return tl::unexpected(with_context(input.file, applied.error()));
    } else if (input.role == "truth" && rig.simulation) {
      rig.simulation->material = path.string();
    } else if (input.role == "profile") {
      if (auto* modbus = std::get_if<ModbusGantry>(&rig.gantry.backend)) modbus->profile = path;
    } else if (input.role == "material") {
      // The copies are the basis, held-out materials already left out.
      spec.materials.source = path.parent_path().string();
      spec.materials.leave_out.clear();
      spec.materials.leave_out_families.clear();
    }
  }
  return {};
}

nlohmann::ordered_json to_json(const std::vector<InputFile>& inputs) {
  auto list = nlohmann::ordered_json::array();
  for (const InputFile& input : inputs) {
    list.push_back({{"role", input.role},
                    {"file", input.file},
                    {"from", input.from},
                    {"sha256", input.sha256}});
  }
  return list;
}

}  // namespace lightrig
