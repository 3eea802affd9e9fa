#pragma once

#include <span>
#include <vector>

#include "core/adaptive_fit.h"
#include "core/azimuth_model.h"
#include "core/fit.h"
#include "core/samples.h"

namespace lightrig {

/// Rows as if each had been measured at its cell's centre and over all φd. A row is the mean of f
/// over the areas that its sites see, which spread within and beyond the cell and lie at certain
/// φd; the table's value belongs to the cell's centre and is a mean over φd. With f̂ the estimate so
/// far,
///   f_row · f̂(centre) / mean over the footprints of f̂ e^d,   d the departure at their φd,
/// f̂ between cell centres interpolated in ln f. What rests on the estimate is doubted: the row's
/// variance grows by (0.3 · ln of that factor)² and by what the azimuth model leaves unsaid. Rows
/// without footprints, and bounds, stay as they are.
BrdfObservations refined(const BrdfObservations& light, const BrdfBasis& basis,
                         const AzimuthModel& azimuths, const Coefficients& estimate);

/// fit_adaptive(), then twice again with the rows refined by the estimate before; lights without
/// footprints are fitted once, as they are.
AdaptiveFit fit_refined(const BrdfBasis& basis, const AzimuthModel& azimuths,
                        std::span<const BrdfObservations> lights, int channels,
                        const FitOptions& options);

}  // namespace lightrig
