#pragma once

#include <functional>
#include <string>
#include <vector>

#include "config/session_spec.h"
#include "core/brdf_table.h"
#include "core/result.h"

namespace lightrig {

struct LoadedMaterials {
  std::vector<Material> materials;
  std::vector<std::string>
      remarks;  ///< per material: what was wrong with it, whether it was left out
};

/// The training set: built in, or every .binary of a directory, sorted by name; held-out ones left
/// out. `read_one`, where there is one, is called after every file. Errors: not_found,
/// invalid_input (fewer than 2 usable, grids differ).
Result<LoadedMaterials> load_materials(const MaterialsConfig& config,
                                       const std::function<void()>& read_one = {});

/// How many materials the source names, without reading them. Errors: as load_materials(), where
/// the folder cannot be listed or holds fewer than 2 files.
Result<std::size_t> count_material_files(const MaterialsConfig& config);

}  // namespace lightrig
