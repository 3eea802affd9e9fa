#pragma once

#include <cstddef>
#include <map>
#include <span>
#include <string>
#include <vector>

#include "core/brdf_table.h"

namespace lightrig {

/// PNG of spheres under an environment light: one line per material (four, from the dullest to
/// the most shining), the truth first, then each of `methods` that `estimates` holds (one table per
/// test material). Every line has one exposure, chosen by its truth. Empty where no method is
/// drawn.
std::vector<std::byte> draw_spheres(std::span<const Material> test,
                                    const std::vector<std::string>& methods,
                                    const std::map<std::string, std::vector<BrdfTable>>& estimates);

}  // namespace lightrig
