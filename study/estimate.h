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
};

/// One result per test material, from the cells that a set of lights shows.

/// The paper's pseudo-inverse on the stacked basis, each channel with its own block of rows; exact
/// values.
std::vector<MaterialResult> estimate_paper(const StudySplit& split,
                                           const std::vector<std::int32_t>& cells, double floor);

/// MAP on the column basis; exact values, so that one factorisation serves every material.
std::vector<MaterialResult> estimate_map(const StudySplit& split,
                                         const std::vector<std::int32_t>& cells, double floor);

/// Either, through fit(), from values with noise and a bracket's clipping. The paper keeps clipped
/// values as they are (dropping them can be worse); MAP takes them as bounds.
std::vector<MaterialResult> estimate_measured(const StudySplit& split, bool map,
                                              const std::vector<std::int32_t>& cells,
                                              const StudyOptions& options, std::uint64_t seed);

/// The mean material alone: no light at all.
std::vector<MaterialResult> estimate_mean(const StudySplit& split, double floor);

}  // namespace lightrig
