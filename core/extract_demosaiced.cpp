#include "core/extract_demosaiced.h"

#include <algorithm>
#include <optional>

#include "core/demosaic.h"

namespace lightrig {
namespace {

// Of n pixels n/4 are red (blue) and n/2 green, and their mean is no better known than theirs:
// σ²·4/n (2/n). The pixels' own variances are σ² at a site, σ²/2 and σ²/4 where two and four are
// averaged: on average 9/16 of σ² (5/8), as if n pixels stood alone.
constexpr double shared_red_or_blue = 4 / (9.0 / 16);
constexpr double shared_green = 2 / (5.0 / 8);

}  // namespace

BrdfObservations extract_demosaiced(const RadianceImage& mosaic, const RadianceImage* ambient,
                                    const SurfacePoints& points, const CameraModel& camera,
                                    const LightPosition& light, const BivariateGrid& grid,
                                    std::span<const std::uint8_t> valid, const Occluder& occluder,
                                    const ExtractOptions& options) {
  if (mosaic.filter == ColorFilter::mono)
    return extract(mosaic, ambient, points, camera, light, grid, valid, occluder, options);
  BrdfObservations all;
  ExtractOptions as_mono = options;
  for (int channel = 0; channel < 3; ++channel) {
    as_mono.lamp_strength = Eigen::Array3d::Constant(options.lamp_strength[channel]);
    Eigen::ArrayXXd least_f;
    if (options.least_f != nullptr) {
      least_f = options.least_f->col(std::min<Eigen::Index>(channel, options.least_f->cols() - 1));
      as_mono.least_f = &least_f;
    }
    std::optional<RadianceImage> unlit;
    if (ambient != nullptr) unlit = demosaiced(*ambient, channel);
    BrdfObservations one = extract(demosaiced(mosaic, channel), unlit ? &*unlit : nullptr, points,
                                   camera, light, grid, valid, occluder, as_mono);
    const auto before = static_cast<std::int32_t>(all.rows.size());
    for (BrdfObservation& row : one.rows) {
      row.channel = static_cast<std::int8_t>(channel);
      row.variance *= channel == 1 ? shared_green : shared_red_or_blue;
    }
    for (Footprint& footprint : one.footprints) footprint.row += before;
    all.rows.insert(all.rows.end(), one.rows.begin(), one.rows.end());
    all.footprints.insert(all.footprints.end(), one.footprints.begin(), one.footprints.end());
    for (BrdfObservation& row : one.black) row.channel = static_cast<std::int8_t>(channel);
    all.black.insert(all.black.end(), one.black.begin(), one.black.end());
    for (BlackSites& sites : one.doubtful) sites.channel = static_cast<std::int8_t>(channel);
    all.doubtful.insert(all.doubtful.end(), one.doubtful.begin(), one.doubtful.end());
    if (channel == 0) all.statistics = one.statistics;
  }
  return all;
}

}  // namespace lightrig
