#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <span>
#include <vector>

#include "core/candidate_bins.h"
#include "core/footprint.h"
#include "core/image.h"
#include "core/light.h"

namespace lightrig {

/// BRDF values measured under one light, averaged per grid cell and channel.
struct BrdfObservation {
  enum class Kind : std::uint8_t {
    value,  ///< f and variance hold
    above,  ///< censored: f is at least this (saturated)
    below,  ///< censored: f is at most this (dark)
  };
  std::int32_t cell = 0;
  std::int8_t channel = 0;
  Kind kind = Kind::value;
  std::int32_t count = 0;  ///< sites averaged (`above`: saturated sites)
  double f = 0;            ///< [1/sr]
  double variance = 0;  ///< [1/sr²] of f, values only: the larger of sensor noise of the mean and
                        ///< scatter of the sites within the cell over count
};

/// What extraction passed over.
struct ExtractionStatistics {
  std::int64_t sites = 0, unlit = 0, shadowed = 0, grazing = 0, invalid_cell = 0;
  std::int64_t saturated = 0, dark = 0;  ///< of the sites used
  /// Pixels that mix radiances: at a silhouette, a step in depth, a crease or the edge of a shadow.
  std::int64_t boundary = 0;
  std::int64_t off_image = 0;  ///< vertices that project outside the image
  /// Black where the lamp must show something (ExtractOptions::least_f): the light is blocked.
  std::int64_t blocked = 0;
};

/// Sites of one cell and channel that are as dark as without the lamp, and are data all the same
/// because a known material may be so dark there.
struct BlackSites {
  std::int32_t cell = 0;
  std::int8_t channel = 0;
  std::int32_t count = 0;
  double telling_f = 0;  ///< [1/sr] a material that shows this there cannot leave all of them black
};

struct BrdfObservations {
  std::vector<BrdfObservation> rows;  ///< sorted by channel, then cell
  ExtractionStatistics statistics;
  /// With ExtractOptions::footprints, of up to so many sites of each row of values.
  std::vector<Footprint> footprints = {};
  /// Rows of the blocked sites of cells that no other site shows, `below` each, sorted like rows:
  /// what there would be to say, were the material itself that dark.
  std::vector<BrdfObservation> black = {};
  /// With ExtractOptions::least_f: what a better idea of the material would call blocked, sorted
  /// like rows.
  std::vector<BlackSites> doubtful = {};
};

struct ExtractOptions {
  GrazingLimits limits;
  Eigen::Array3d lamp_strength =
      Eigen::Array3d::Ones();    ///< [W/sr] near, [W/m²] distant, per channel
  double detection_sigma = 3.0;  ///< a cell whose mean is below this many sigmas is `below`
  bool drop_mixed = true;        ///< leave out pixels at silhouettes, creases and edges of shadows
  int footprints = 0;  ///< most sites of a row whose footprints are kept, evenly over its sites
  const PixelNeighbours* neighbours = nullptr;  ///< of the points; null: found for this call alone
  /// (cells × channels) [1/sr] the least that a known material shows, or that this one is known to.
  /// A lit pixel within
  /// detection_sigma of no light at all, where this much would be three times as far from it, is
  /// blocked: something stands before the lamp that the model does not know. It and the pixels
  /// beside it are left out. Null: a black pixel is a dark material. Points of pixels only.
  const Eigen::ArrayXXd* least_f = nullptr;
  int threads = 1;
};

/// f = L / (E cos θi) at every surface point's site, averaged per cell as ΣL/ΣE cos θi: weights by
/// geometry alone, which noise that follows the signal cannot bias. `ambient` (lamp off) is
/// subtracted where given. Points must come from pixels, or project to the nearest site. Shadowed
/// points are told by `occluder`. Dark sites count with their estimate; a cell is `below` only when
/// its whole mean is under its noise (f = upper bound), and `above` when most of its sites are
/// saturated (f = lower bound). The result does not depend on `threads`.
BrdfObservations extract(const RadianceImage& image, const RadianceImage* ambient,
                         const SurfacePoints& points, const CameraModel& camera,
                         const LightPosition& light, const BivariateGrid& grid,
                         std::span<const std::uint8_t> valid, const Occluder& occluder,
                         const ExtractOptions& options);

}  // namespace lightrig
