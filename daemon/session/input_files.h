#pragma once

#include <filesystem>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "config/rig.h"
#include "core/brdf_table.h"
#include "core/result.h"
#include "daemon/session/session_folder.h"

namespace lightrig {

/// A file that the rig or session file names, as the session folder keeps it, so that the folder
/// can be reduced on a machine that has nothing else.
struct InputFile {
  std::string role;  ///< "mesh", "reference", "calibration", "profile", "truth", "material"
  std::string file;  ///< relative to the session folder, e.g. "inputs/mesh/bunny.ply"
  std::string from;  ///< where it was read
  std::string sha256;
};

/// Copies what the rig and the session name into inputs/. Files are copied byte for byte, but for a
/// directory of materials: there the bivariate table of each material of the basis is kept, as a
/// MERL file with one φd slice (0.2 MB instead of 33 MB a material). Errors: not_found, no_space,
/// refused.
Result<std::vector<InputFile>> copy_inputs(const SessionFolder& folder, const Rig& rig,
                                           const SessionSpec& spec,
                                           const std::vector<Material>& materials);

/// Lets rig and spec name the copies instead of the originals. Errors: invalid_input when a copy is
/// missing or is not what it was, naming it.
Result<void> use_inputs(const SessionFolder& folder, const std::vector<InputFile>& inputs, Rig& rig,
                        SessionSpec& spec);

nlohmann::ordered_json to_json(const std::vector<InputFile>& inputs);

}  // namespace lightrig
