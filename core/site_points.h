#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "core/cell_lookup.h"
#include "core/pixel_neighbours.h"
#include "core/samples.h"

namespace lightrig {

/// What became of a surface point on the way to a sample.
enum class PointState : std::uint8_t {
  unlit,
  grazing,
  invalid_cell,
  boundary,
  off_image,
  lit,
  shadowed,
  blocked
};

/// Small, because a picture has millions: what is not kept is found again for the lit ones.
struct SitePoint {
  std::int32_t cell_or_state = -1;  ///< the cell if lit, else −1 − state
  float irradiance = 0;             ///< falloff · cos θi, per unit of lamp strength

  void set(PointState state) { cell_or_state = -1 - static_cast<std::int32_t>(state); }
  bool lit() const { return cell_or_state >= 0; }
  PointState state() const {
    return lit() ? PointState::lit : static_cast<PointState>(-1 - cell_or_state);
  }
  int cell() const { return cell_or_state; }
};

/// What places a point: borrowed, for the length of one extraction.
struct SiteGeometry {
  const SurfacePoints* points = nullptr;
  const CameraModel* camera = nullptr;
  const LightPosition* light = nullptr;
  const CellLookup* cells = nullptr;
  std::span<const std::uint8_t> valid;
  const Occluder* occluder = nullptr;
  const GrazingLimits* limits = nullptr;
  double max_tangent2 = 0;  ///< tan² of the largest θd
};

/// The site that records a point: its own pixel, or the one it projects into.
std::optional<std::int32_t> site_of(const SiteGeometry& g, Eigen::Index i, int width, int height);

/// What every point is under the light, shadows included; a point for each of g.points.
std::vector<SitePoint> place_all(const SiteGeometry& g, int width, int height, int threads);

/// Marks lit pixels that mix two radiances: their centre's geometry says nothing of their value.
void leave_out_mixed(const PixelNeighbours& neighbours, std::vector<SitePoint>& sites);

/// Points that are as dark as without the lamp.
struct BlackPoints {
  std::vector<std::size_t> blocked;  ///< the marked points
  std::vector<BlackSites> doubtful;  ///< black, and as it may be
};
/// Marks as blocked the lit pixels that are black where even the darkest known material
/// (options.least_f) would not be, and leaves out those beside them, which may be half black.
BlackPoints leave_out_blocked(const RadianceImage& image, const RadianceImage* ambient,
                              const SiteGeometry& g, const PixelNeighbours& neighbours,
                              const ExtractOptions& options, std::vector<SitePoint>& sites);

}  // namespace lightrig
