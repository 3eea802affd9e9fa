#pragma once

#include <span>
#include <vector>

#include "core/image.h"
#include "core/result.h"

namespace lightrig {

/// The columns of every row of a picture that matter, [begin, end); an empty row has begin = end.
struct RowSpans {
  std::vector<std::int32_t> begin, end;  ///< (height)
};
/// The spans that hold all of these sites (row · width + column).
RowSpans spans_of_sites(std::span<const std::int32_t> sites, int width, int height);

struct MergeOptions {
  double saturation_margin =
      0.02;  ///< [fraction of full scale] counts this close to white or full well are excluded
  double detection_sigma = 3.0;  ///< a site whose summed signal is below this many sigmas is `dark`
  int rounds = 3;                ///< re-weighting rounds of the maximum-likelihood estimate
  int threads = 1;
  /// Only these are merged; every other site is `saturated` with L = 0: at least nothing, which is
  /// to say nothing. Null: all.
  const RowSpans* spans = nullptr;
};

/// Best linear radiance of a bracket by inverse variance of shot, read and quantisation noise,
/// re-weighted from its own estimate [Hasinoff 2010; Granados 2010]. `dark` holds lamp-off frames,
/// subtracted at equal exposure where there is one, else by black level and dark current; their
/// variance is carried. Errors: invalid_input for no frame, unequal sizes, an exposure that is not
/// positive. No allocation per pixel.
Result<RadianceImage> merge_hdr(std::span<const Frame> bracket, std::span<const Frame> dark,
                                const SensorModel& sensor, const MergeOptions& options);

/// Which of the exposures on offer a scene needs, judged from one metering frame.
struct ExposureChoice {
  std::vector<double> exposures;  ///< [s], shortest first, at least one
  std::vector<double> skipped;    ///< [s]
  double brightest =
      0;  ///< [e⁻/s] of the brightest lit site as metered (a lower bound where saturated)
  double darkest = 0;  ///< [e⁻/s] of the dimmest lit site worth measuring
};
/// `lit` (height · width, 1 = a sample will be taken there). Keeps the longest exposure that
/// saturates no lit site, what lies between it and the longest that lifts the darkest lit site to
/// `target_snr`, and no other.
ExposureChoice choose_exposures(const Frame& metering, std::span<const std::uint8_t> lit,
                                std::span<const double> offered, const SensorModel& sensor,
                                double target_snr);

}  // namespace lightrig
