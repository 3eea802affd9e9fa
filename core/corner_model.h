#pragma once

#include <Eigen/Core>
#include <vector>

#include "core/calibration_target.h"

namespace lightrig {

/// Where corners of a checkerboard are to a few hundredths of a pixel: two straight edges, each a
/// step as wide as the lens and the pixels make it, that cross: m + c erf(d₁/s) erf(d₂/s), fitted
/// by Levenberg–Marquardt to what surrounds each corner [Mallon & Whelan 2007]. Unlike a fit to
/// gradients it has no bias from the window or from what lies near its rim. `corners` are known to
/// about a pixel; a corner that the model does not fit, or that would move by more than that, stays
/// as it is. Of a ChArUco board the markers are kept out.
TargetCorners refined(const GreyImage& image, const CalibrationTarget& target,
                      TargetCorners corners);

}  // namespace lightrig
