#pragma once

#include <Eigen/Geometry>
#include <array>
#include <cstdint>
#include <random>
#include <vector>

#include "core/calibrate_camera.h"
#include "core/calibration_target.h"
#include "core/camera_model.h"

namespace lightrig::test {

/// Directions of sight of a camera at the corners of its pixels, found once for all pictures; the
/// camera looks along +z from the origin.
class Sights {
 public:
  explicit Sights(const CameraModel& camera);
  /// Through pixel coordinates [px] within the picture, bilinear within a pixel: z = 1.
  Eigen::Vector3d through(double u, double v) const;

  int width, height;

 private:
  std::vector<Eigen::Vector3d> corners_;  // ((height + 1) · (width + 1))
};

/// How a picture of a target comes about.
struct TargetPicture {
  double blur = 0.5;  ///< [px] of the lens: standard deviation
  double noise = 0;   ///< [DN] of a pixel
  int samples = 4;    ///< squared, to a pixel, each anywhere in its part: no grid to meet edges
};

/// The printed target seen from where `camera_from_target` has it, in a picture of 8 bits: light of
/// the target over each pixel and the lens's blur, then noise, then rounding. `texture`: as of
/// target_image(), so many pixels to a square.
GreyImage picture_of_target(const Sights& sights, const Eigen::Isometry3d& camera_from_target,
                            const GreyImage& texture, const CalibrationTarget& target,
                            int pixels_per_square, const TargetPicture& how,
                            std::mt19937_64& random);

/// As a person would take them: the target tilted by 5° to 35° to any side and turned, brought to
/// every part of the picture, and wholly in it where `whole`.
std::vector<Eigen::Isometry3d> drawn_views(const CameraModel& camera,
                                           const CalibrationTarget& target, int count, bool whole,
                                           std::mt19937_64& random);

/// Its inner corners where the lens has them, those within the picture.
TargetCorners true_corners(const CameraModel& camera, const Eigen::Isometry3d& camera_from_target,
                           const CalibrationTarget& target);

/// How far a calibration is off the truth, in the standard errors that it states.
struct Deviations {
  std::array<double, 9> lens{};              ///< fx, fy, cx, cy, k1, k2, p1, p2, k3
  std::vector<std::array<double, 6>> poses;  ///< of every view: its turn vector, its shift
};
Deviations deviations(const CameraCalibration& calibration, const CameraModel& truth,
                      const std::vector<Eigen::Isometry3d>& camera_from_target);

}  // namespace lightrig::test
