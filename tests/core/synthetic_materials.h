#pragma once

#include <cmath>
#include <random>
#include <string>
#include <vector>

#include "core/brdf_table.h"

namespace lightrig {

/// Materials drawn at random for tests of the statistics: a base and a lobe whose ln varies
/// smoothly over the grid. Not a model of anything.
inline std::vector<Material> synthetic_materials(int count, const BivariateGrid& grid,
                                                 std::uint64_t seed, int channels = 3) {
  std::mt19937_64 random(seed);
  std::normal_distribution<double> normal;
  std::vector<Material> out;
  for (int m = 0; m < count; ++m) {
    Material material{"material-" + std::to_string(m), "", "drawn", {grid, {}}};
    material.table.f.resize(grid.cells(), channels);
    const double width = std::exp(-1.5 + 0.6 * normal(random));
    const double height = 1.5 * normal(random), retro = 0.3 * normal(random);
    for (int channel = 0; channel < channels; ++channel) {
      const double base = -2 + normal(random);
      for (int cell = 0; cell < grid.cells(); ++cell) {
        const double h = (grid.row_h(cell) + 0.5) / grid.n_h;
        const double d = (grid.column_d(cell) + 0.5) / grid.n_d;
        const double ripple = 0.02 * normal(random);
        material.table.f(cell, channel) = std::exp(base + height * std::exp(-h * h / width) +
                                                   retro * std::cos(3 * d) * d + ripple);
      }
    }
    out.push_back(std::move(material));
  }
  return out;
}

}  // namespace lightrig
