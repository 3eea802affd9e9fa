#pragma once

#include "core/image.h"

namespace lightrig {

/// One channel of a mosaic at every pixel, as a mono image: at the channel's own sites its value,
/// elsewhere the mean of the nearest sites of that colour (two or four of them), as OpenCV's
/// bilinear demosaicing does with integers; at the rim the mean of those there are. Variances of
/// what is averaged are carried; neighbouring pixels then share noise. A pixel is saturated, and
/// its value a lower bound, where any site averaged is; dark where all are.
RadianceImage demosaiced(const RadianceImage& mosaic, int channel);

}  // namespace lightrig
