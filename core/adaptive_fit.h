#pragma once

#include <span>

#include "core/fit.h"

namespace lightrig {

/// A fit whose model error was judged by the data it fits.
struct AdaptiveFit {
  Coefficients coefficients;
  double model_sigma = 0;  ///< mapped units, as used; at least the basis' own
  bool raised = false;     ///< the data showed more model error than the basis expected
};

/// fit(), and where the estimator is MAP and the rows miss their fit by more than their noise and
/// the basis' model_sigma explain, again with a larger one: σ² = Σ w (r² N/(N − γ) − v) / Σ w over
/// the value rows, v their noise, w = 1/(σ² + v)², γ = Σ (1 − C_jj/s_j²) the number of coefficients
/// the data determine [MacKay 1992, eq. 4.10], until it stays within 2 %. Never below the basis'
/// σ: a basis of materials much alike knows little of how unlike a new one may be, and a fit that
/// believes it overfits. A material of the basis' own kind is fitted exactly as by fit().
AdaptiveFit fit_adaptive(const BrdfBasis& basis, std::span<const BrdfObservations> lights,
                         int channels, const FitOptions& options);

}  // namespace lightrig
