#include "config/load_materials.h"

#include <fmt/format.h>

#include <algorithm>
#include <filesystem>
#include <optional>

#include "config/read_bytes.h"
#include "core/azimuth_model.h"
#include "core/builtin_materials.h"

namespace lightrig {
namespace {

namespace fs = std::filesystem;

bool contains(const std::vector<std::string>& names, const std::string& name) {
  return std::ranges::find(names, name) != names.end();
}

Result<LoadedMaterials> load_builtin(const MaterialsConfig& config) {
  constexpr int phi_samples = 16;  // over 0 … π; the built-in models are smooth in φd
  LoadedMaterials loaded;
  std::vector<const BuiltinMaterial*> used;
  for (const BuiltinMaterial& m : builtin_materials()) {
    if (contains(config.leave_out, m.name) || contains(config.leave_out_families, m.family))
      loaded.remarks.push_back(fmt::format("{} ({}): held out, as asked", m.name, m.family));
    else
      used.push_back(&m);
  }
  loaded.materials = builtin_tables(used, BivariateGrid{}, phi_samples, true);
  return loaded;
}

struct Loaded {
  std::optional<Material> material;
  std::string remark;  ///< "" when there is nothing to say
};

Loaded load_file(const fs::path& file) {
  const std::string name = file.stem().string();
  const auto left_out = [&](const std::string& why) {
    return Loaded{std::nullopt, fmt::format("{}: left out: {}", name, why)};
  };
  const auto bytes = read_bytes(file);
  if (!bytes) return left_out(bytes.error().message);
  MerlFindings findings;
  const auto table = decode_merl(*bytes, findings);
  if (!table) return left_out(table.error().message);
  Loaded loaded;
  loaded.material = Material{name, "", file.filename().string(), to_bivariate(*table),
                             azimuth_departures(*table)};
  if (!(loaded.material->table.f.isFinite()).any()) return left_out("it holds no valid value");
  if (findings.not_a_number + findings.too_large > 0)
    loaded.remark = fmt::format(
        "{}: of {} values {} are not numbers, {} above {:g} 1/sr and {} negative: ignored", name,
        table->f.size(), findings.not_a_number, findings.too_large, most_reflectance,
        findings.negative);
  else if (findings.negative > 0)
    loaded.remark = fmt::format(
        "{}: {} of {} values are negative: ignored (MERL marks cells without "
        "a measurement so)",
        name, findings.negative, table->f.size());
  return loaded;
}

Result<std::vector<fs::path>> binaries_in(const fs::path& folder) {
  std::error_code error;
  std::vector<fs::path> files;
  fs::directory_iterator at(folder, error);
  if (error) {
    const auto code = error == std::errc::no_such_file_or_directory ? ErrorCode::not_found
                                                                    : ErrorCode::invalid_input;
    return fail(code, fmt::format("read the materials in '{}': {}; name a folder of MERL .binary "
                                  "files, or \"builtin\"",
                                  folder.string(), error.message()));
  }
  for (; at != fs::directory_iterator(); at.increment(error)) {
    if (error) break;
    if (at->path().extension() == ".binary") files.push_back(at->path());
  }
  if (error)
    return fail(ErrorCode::refused,
                fmt::format("read the materials in '{}': {}", folder.string(), error.message()));
  std::ranges::sort(files, {}, [](const fs::path& p) { return p.filename().string(); });
  return files;
}

// A folder with two kinds of grid is a mistake that a person must look at.
Result<void> check_grids(const LoadedMaterials& loaded, const fs::path& folder) {
  const Material& first = loaded.materials.front();
  for (const Material& m : loaded.materials)
    if (m.table.grid != first.table.grid)
      return fail(ErrorCode::invalid_input,
                  fmt::format("the materials in '{}' have different grids: '{}' has {} × {} cells, "
                              "'{}' has {} × {}; keep one kind in a folder",
                              folder.string(), first.name, first.table.grid.n_h,
                              first.table.grid.n_d, m.name, m.table.grid.n_h, m.table.grid.n_d));
  return {};
}

Result<LoadedMaterials> load_folder(const MaterialsConfig& config,
                                    const std::function<void()>& read_one) {
  const fs::path folder(config.source);
  auto files = binaries_in(folder);
  if (!files) return tl::unexpected(files.error());
  LoadedMaterials loaded;
  std::vector<std::string> held_out;
  for (const fs::path& file : *files) {
    if (contains(config.leave_out, file.stem().string())) {
      held_out.push_back(file.stem().string());
      loaded.remarks.push_back(file.stem().string() + ": held out, as asked");
      continue;
    }
    Loaded one = load_file(file);
    if (read_one) read_one();
    if (one.material) loaded.materials.push_back(std::move(*one.material));
    if (!one.remark.empty()) loaded.remarks.push_back(std::move(one.remark));
  }
  for (const std::string& name : config.leave_out)
    if (!contains(held_out, name))
      return fail(ErrorCode::not_found,
                  fmt::format("hold out '{}': '{}' has no {}.binary", name, folder.string(), name));
  if (loaded.materials.size() < 2) {
    std::string why;
    for (const std::string& remark : loaded.remarks) why += "; " + remark;
    return fail(ErrorCode::invalid_input,
                fmt::format("'{}' holds {} .binary file{}, {} usable; statistics need at least 2 "
                            "materials: put MERL .binary files there, or name another folder or "
                            "\"builtin\" as the source{}",
                            folder.string(), files->size(), files->size() == 1 ? "" : "s",
                            loaded.materials.size(), why));
  }
  if (auto same = check_grids(loaded, folder); !same) return tl::unexpected(same.error());
  return loaded;
}

}  // namespace

Result<LoadedMaterials> load_materials(const MaterialsConfig& config,
                                       const std::function<void()>& read_one) {
  auto loaded = config.source == "builtin" ? load_builtin(config) : load_folder(config, read_one);
  if (loaded && loaded->materials.size() < 2)
    return fail(ErrorCode::invalid_input,
                fmt::format("{} materials remain of the built-in set after holding out what was "
                            "asked; statistics need at least 2",
                            loaded->materials.size()));
  return loaded;
}

Result<std::size_t> count_material_files(const MaterialsConfig& config) {
  if (config.source == "builtin") return builtin_materials().size();
  const auto files = binaries_in(config.source);
  if (!files) return tl::unexpected(files.error());
  if (files->size() < 2)
    return fail(
        ErrorCode::invalid_input,
        fmt::format("'{}' holds {} .binary file{}; statistics need at least 2 materials: put "
                    "MERL .binary files there, or name another folder or \"builtin\" as the "
                    "source",
                    config.source, files->size(), files->size() == 1 ? "" : "s"));
  return files->size();
}

}  // namespace lightrig
