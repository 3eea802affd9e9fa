#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "core/planner_kernels.h"
#include "core/planner_rows.h"

namespace lightrig {

/// The triangular factor of [R; rows of these cells], (min(rows, k) × stride), into `out`; R has
/// one row per "cell", as many as there are, and may be empty. `scratch` is memory to use again.
void extend_factor(const PackedRows& R, const PackedRows& rows, std::span<const std::int32_t> cells,
                   PackedRows& out, std::vector<double>& scratch, int level);

/// Rank and κ² of rows by the eigenvalues of their Gram matrix, an upper triangle (k × stride),
/// where these tell κ² to about 1e-12; else none.
std::optional<Conditioning> conditioning_of_gram(std::span<const double> gram, int k, int stride);

/// Rank and κ² of the `rows` rows that R is the factor of: by the eigenvalues of RᵀR while they
/// tell κ² to about 1e-12, else by the singular values of R.
Conditioning conditioning_of_factor(const PackedRows& R, Eigen::Index rows);

/// |Rx|² and |Ry|²; 0 for an empty R.
struct FactorEnergies {
  double of_x = 0, of_y = 0;
};
FactorEnergies energies_of_factor(const PackedRows& R, std::span<const double> x,
                                  std::span<const double> y, int level);

}  // namespace lightrig
