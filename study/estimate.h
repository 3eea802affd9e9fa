#pragma once

#include <span>
#include <vector>

#include "core/brdf_basis.h"
#include "core/brdf_error.h"
#include "study/job.h"

namespace lightrig {

/// How one material came out.
struct MaterialResult {
  BrdfError error;
  double predicted = 0, low = 0, high = 0;  ///< [%]; NaN: the estimator makes none
  BrdfTable estimate;
};

/// One result per test material, from the cells that a set of lights shows.

/// The paper's pseudo-inverse on a stacked basis, each channel with its own block of rows; exact
/// values.
std::vector<MaterialResult> estimate_paper(const BrdfBasis& basis, std::span<const Material> test,
                                           const std::vector<std::int32_t>& cells, double floor);

/// MAP on a column basis; exact values, so that one factorisation serves every material.
std::vector<MaterialResult> estimate_map(const BrdfBasis& basis, std::span<const Material> test,
                                         const std::vector<std::int32_t>& cells, double floor);

/// What the cells are measured with.
struct MeasuredRows {
  int exposures = 0;  ///< [StudyOptions]
  bool metered = true;
  double noise = 0;
  double floor = 1e-4;  ///< [1/sr]
  std::uint64_t seed = 0;
};

/// Either, through fit(), from values with noise and a bracket's clipping. The paper keeps clipped
/// values as they are (dropping them can be worse); MAP takes them as bounds.
std::vector<MaterialResult> estimate_measured(const BrdfBasis& basis,
                                              std::span<const Material> test, bool map,
                                              const std::vector<std::int32_t>& cells,
                                              const MeasuredRows& measured);

/// The mean material alone: no light at all.
std::vector<MaterialResult> estimate_mean(const BrdfBasis& basis, std::span<const Material> test,
                                          double floor);

/// What a table without φd cannot say of a material: 100·‖ln f − ln mean over φd‖/‖ln f‖ over cells
/// and shares of φd; 0 for materials without φd.
std::vector<MaterialResult> bivariate_error(std::span<const Material> test, double floor);

}  // namespace lightrig
