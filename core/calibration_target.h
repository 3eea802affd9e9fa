#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "core/result.h"

namespace lightrig {

/// An 8-bit grey image, rows from the top.
struct GreyImage {
  int width = 0, height = 0;
  std::vector<std::uint8_t> pixels;  ///< (height · width)
};

/// A flat target of known size: a checkerboard, or a ChArUco board, whose white squares hold
/// markers of the dictionary DICT_5X5_1000 in OpenCV's order, so that it may be partly out of the
/// picture.
struct CalibrationTarget {
  enum class Kind : std::uint8_t { charuco, checkerboard };
  Kind kind = Kind::charuco;
  int columns = 9, rows = 6;  ///< squares, not inner corners
  double square = 0.02;       ///< [m] edge of a square
  double marker = 0.015;      ///< [m] edge of a marker (ChArUco)

  int corners() const { return (columns - 1) * (rows - 1); }
};

/// Inner corners found in one image. The target's frame: z = 0, origin at a corner of the board,
/// x along its columns, y along its rows, as OpenCV has it.
struct TargetCorners {
  std::vector<Eigen::Vector2d> pixel;  ///< [px]
  std::vector<Eigen::Vector3d> point;  ///< [m] the same corners on the target
  /// Edges of the markers over those of the squares, as this image shows them (ChArUco).
  std::vector<double> marker_shares;
};

/// Finds the target's inner corners to a fraction of a pixel [OpenCV aruco, calib3d]. Errors:
/// not_found, saying what of the target was seen and what to do; invalid_input for a target that
/// cannot be.
Result<TargetCorners> find_corners(const GreyImage& image, const CalibrationTarget& target);

/// The target as an image to be printed, so many pixels to a square, with a white margin of half a
/// square. Errors: invalid_input for a target that cannot be.
Result<GreyImage> target_image(const CalibrationTarget& target, int pixels_per_square);

}  // namespace lightrig
