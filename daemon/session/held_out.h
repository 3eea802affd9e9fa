#pragma once

#include <span>

#include "core/fit.h"
#include "core/samples.h"

namespace lightrig {

/// The held-out light: captured, not fitted, predicted.
struct HeldOutError {
  double percent = 0;  ///< scaled to the whole grid, at most 2.5-fold; well below the true error
                       ///< all the same [docs/results.md]: it looks where other lights did
  double seen_percent = 0;  ///< over the bins the light shows
  int rows = 0;             ///< bins × channels compared
};

/// How far measured bins are from the reconstruction, in the terms of the percentage error:
/// seen = 100 · √(mean (ln f̂ − ln f)² − mean noise²) / rms ln f̂ over the table, floor applied to
/// both; noise is the measurement's own variance, carried to ln; means over the bins weighted by
/// 1/(noise² + posterior²)², so that bins that are mostly noise say little; never less than the
/// standard error of that difference, the least that can be told from noise. percent = seen · (rms
/// posterior standard deviation over the table / the same over the bins seen): what such a misfit
/// here says of the whole table, if the posterior has the proportions right. No rows: NaN.
HeldOutError held_out_error(std::span<const BrdfObservations> held_out,
                            const Reconstruction& reconstruction, double floor);

}  // namespace lightrig
