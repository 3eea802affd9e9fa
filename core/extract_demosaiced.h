#pragma once

#include "core/samples.h"

namespace lightrig {

/// extract() from a mosaic whose colours are interpolated to every pixel first: each channel taken
/// as a mono image of its own. Variances of the rows count that neighbouring pixels share sites.
/// Statistics are those of the first channel. A mono image is extracted as it is.
BrdfObservations extract_demosaiced(const RadianceImage& mosaic, const RadianceImage* ambient,
                                    const SurfacePoints& points, const CameraModel& camera,
                                    const LightPosition& light, const BivariateGrid& grid,
                                    std::span<const std::uint8_t> valid, const Occluder& occluder,
                                    const ExtractOptions& options);

}  // namespace lightrig
