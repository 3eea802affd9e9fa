#pragma once

#include <span>
#include <string>
#include <vector>

#include "core/brdf_table.h"
#include "core/reflectance_models.h"

namespace lightrig {

/// A material of the built-in set: a published model with published constants.
struct BuiltinMaterial {
  std::string name;
  std::string family;
  std::string source;               ///< citations of models and constants, as in docs/sources.md
  Reflectance reflectance;          ///< continuous, reciprocal, non-negative, energy-conserving
  const LayeredReflectance* model;  ///< the same; lives as long as the set
};

/// All of them, sorted by name; the order never depends on the machine. Made at the first call,
/// once, in a fraction of a second.
std::span<const BuiltinMaterial> builtin_materials();

/// The one with this name, or nullptr.
const BuiltinMaterial* find_builtin(const std::string& name);

/// Materials of the set tabulated for training, means over n_phi values of φd spread over those for
/// which both directions are above the horizon: unlike tabulate(), every cell has a value. About
/// 2 ms a material on 90 × 90 × 16. With `with_azimuths` also how f runs with φd [azimuth_model.h].
std::vector<Material> builtin_tables(std::span<const BuiltinMaterial* const> materials,
                                     const BivariateGrid& grid, int n_phi,
                                     bool with_azimuths = false);
std::vector<Material> builtin_tables(const BivariateGrid& grid, int n_phi);  ///< the whole set

}  // namespace lightrig
