#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "core/surface_points.h"

namespace lightrig {

/// What the pixels around a surface point say of it: whether its own pixel shows one smooth piece
/// of surface, and how position and normal run across that pixel. Neighbours are one point spacing
/// away (the stride the points were taken with). Only for points that come from pixels.
class PixelNeighbours {
 public:
  /// `width` and `height` of the image [px]. The points must outlive it.
  PixelNeighbours(const SurfacePoints& points, int width, int height);

  /// No: a neighbour is missing (silhouette, image border) or far off the tangent plane (a step in
  /// depth), or the normal turns so much or so unevenly across the pixel, more than across a
  /// typical one of this picture, that its value is a mean over several cells of the grid.
  bool whole(Eigen::Index i) const { return whole_[static_cast<std::size_t>(i)] != 0; }

  /// (points) 1: any of the eight neighbours has its flag set (points). Takes as long as there are
  /// flags, which are mostly few.
  std::vector<std::uint8_t> beside(const std::vector<std::uint8_t>& flagged) const;

  /// Change per pixel along columns (u) and rows (v), by central differences; i must be whole.
  struct Slopes {
    Eigen::Vector3d position_u, position_v;  ///< [m/px]
    Eigen::Vector3d normal_u, normal_v;      ///< [rad/px]
  };
  Slopes slopes(Eigen::Index i) const;

  /// The whole points by themselves, for planning.
  SurfacePoints whole_points() const;

 private:
  /// Point `rows` below and `columns` right of it, or −1.
  std::int32_t at(Eigen::Index i, int rows, int columns) const;
  void find_whole();
  bool in_one_piece(Eigen::Index i) const;
  /// Second difference of the normal [rad/px²].
  double bend_along(Eigen::Index i, int rows, int columns) const;

  const SurfacePoints& points_;
  int width_, height_, spacing_;
  std::vector<std::int32_t> index_;  ///< (height · width): point of a pixel, or −1
  std::vector<std::uint8_t> whole_;  ///< (points)
};

}  // namespace lightrig
