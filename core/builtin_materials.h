#pragma once

#include <span>
#include <string>
#include <vector>

#include "core/brdf_table.h"

namespace lightrig {

/// A material of the built-in set: a published model with published constants.
struct BuiltinMaterial {
  std::string name;
  std::string family;
  std::string source;       ///< citation of model and constants [docs/sources.md]
  Reflectance reflectance;  ///< continuous, reciprocal, non-negative, energy-conserving
};

/// All of them, sorted by name; the order never depends on the machine.
std::span<const BuiltinMaterial> builtin_materials();

/// The one with this name, or nullptr.
const BuiltinMaterial* find_builtin(const std::string& name);

}  // namespace lightrig
