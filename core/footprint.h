#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>

#include "core/bivariate_grid.h"
#include "core/camera_model.h"
#include "core/light.h"
#include "core/pixel_neighbours.h"
#include "core/surface_points.h"

namespace lightrig {

/// Where on the grid the area that one site sees lies: four places that stand for a quarter of it
/// each, in cells from the grid's edge, so that the centre of cell (i, j) is (i + ½, j + ½).
struct Footprint {
  std::int32_t row = 0;    ///< of BrdfObservations::rows that the site is part of
  float weight = 0;        ///< E cos θi [W/m²]: the site's share in that row's mean
  float azimuth = 1;       ///< azimuth_share() at the site's centre
  std::array<float, 4> h;  ///< [0, n_h], square-root warped as the grid is
  std::array<float, 4> d;  ///< [0, n_d]
};

/// Footprint of point i under a light. Position and normal at the quarters' middles come from the
/// neighbouring pixels' by central differences; a point without `neighbours`, or whose pixel is not
/// whole, is four times its own centre. Row and weight are left to the caller.
Footprint footprint_of(const SurfacePoints& points, Eigen::Index i,
                       const PixelNeighbours* neighbours, const CameraModel& camera,
                       const LightPosition& light, const BivariateGrid& grid);

}  // namespace lightrig
