#pragma once

#include <Eigen/Geometry>
#include <array>
#include <span>
#include <vector>

#include "core/calibration_target.h"
#include "core/camera_model.h"
#include "core/result.h"

namespace lightrig {

/// How one image fits the calibration.
struct ViewFit {
  int corners = 0;
  double rms = 0, worst = 0;  ///< [px] of the corners' distances from where the model has them
  Eigen::Isometry3d camera_from_target = Eigen::Isometry3d::Identity();
  Eigen::Matrix<double, 6, 1> pose_sigma;  ///< standard errors: turn [rad] ×3, shift [m] ×3
  Eigen::Matrix<double, 6, 6> pose_covariance = Eigen::Matrix<double, 6, 6>::Zero();  ///< of these
};

struct CameraCalibration {
  CameraModel model;  ///< intrinsics and distortion; camera_from_world of the first view's target
  /// Standard errors of fx, fy, cx, cy [px], k1, k2, p1, p2, k3.
  std::array<double, 9> sigma{};
  double rms = 0;          ///< [px] over all corners
  double noise = 0;        ///< [px] per coordinate, from the residuals and the degrees of freedom
  double covered = 0;      ///< [0, 1] share of the picture within the corners' hull
  double tilt_spread = 0;  ///< [rad] greatest angle between two views' target normals
  std::vector<ViewFit> views;
};

/// Where a camera stands in the rig, with standard errors.
struct RigPose {
  Eigen::Isometry3d camera_from_rig = Eigen::Isometry3d::Identity();
  Eigen::Vector3d eye_sigma = Eigen::Vector3d::Zero();   ///< [m] along the rig's axes
  Eigen::Vector3d turn_sigma = Eigen::Vector3d::Zero();  ///< [rad] about the rig's axes
};

/// The camera's pose by an image of a target whose place in the rig is known. The errors are those
/// of the corners found and the lens fitted; how well the target's place was measured is the
/// caller's to know.
RigPose pose_in_rig(const ViewFit& view, const Eigen::Isometry3d& rig_from_target);

/// Intrinsics, distortion and poses that fit the corners best [Zhang 2000; OpenCV calibrateCamera],
/// with standard errors from the residuals and the normal matrix at the optimum. Refused
/// (invalid_input), with the reason and what to do: fewer than four views, views too alike in tilt
/// (the focal length is then not determined), corners over too small a part of the picture (the
/// distortion is then not), residuals above one pixel, or no optimum. Residuals are looked at
/// first: of a target that is another than the one described nothing else means anything.
Result<CameraCalibration> calibrate_camera(std::span<const TargetCorners> views, int width,
                                           int height);

}  // namespace lightrig
