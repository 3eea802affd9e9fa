#pragma once

#include "core/brdf_basis.h"

namespace lightrig {

/// How far an estimate is from a truth, on the cells where both are valid. Several measures, always
/// reported together.
struct BrdfError {
  double percent_log =
      0;  ///< 100·‖ln f̂ − ln f‖₂/‖ln f‖₂, f in 1/sr, floor applied to both [Ali 2013]
  double percent_linear_cos =
      0;  ///< 100·‖(f̂ − f) cosθ‖₂/‖f cosθ‖₂, cosθ = cos θi cos θo at the cell
  double median_abs_log = 0;  ///< median |ln f̂ − ln f|
  int cells = 0;              ///< cells × channels compared
};
BrdfError brdf_error(const BrdfTable& estimate, const BrdfTable& truth, double floor);

}  // namespace lightrig
