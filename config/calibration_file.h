#pragma once

#include <Eigen/Geometry>
#include <filesystem>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "config/rig.h"
#include "core/calibrate_camera.h"

namespace lightrig {

/// A file that a calibration was made from, as it was then.
struct MadeFrom {
  std::string name;    ///< without its folder
  std::string sha256;  ///< of its bytes
};

/// The target as it lay in the rig's frame in one of the images, and with it the camera.
struct TargetInRig {
  std::size_t view = 0;  ///< index into CameraCalibration::views
  Eigen::Isometry3d rig_from_target = Eigen::Isometry3d::Identity();
};

/// Where a target lies: its origin [m], and the directions in which its columns and its rows are
/// counted, all in the rig's frame. Errors: invalid_input for directions of no length, or not
/// square to each other within a degree.
Result<Eigen::Isometry3d> rig_from_target(const Eigen::Vector3d& origin,
                                          const Eigen::Vector3d& columns,
                                          const Eigen::Vector3d& rows);

/// What `lightrig calibrate camera` writes (schema "lightrig.camera/1"): date, intrinsics,
/// distortion, standard errors, residuals and pose of every image, the camera's pose in the rig's
/// frame and its standard errors where `placed` says where the target lay, and a hash of all of it,
/// so that a file changed by hand is not taken for a calibration.
std::string camera_calibration_text(const CameraCalibration& calibration,
                                    const CalibrationTarget& target,
                                    std::span<const MadeFrom> images, const std::string& date,
                                    const std::optional<TargetInRig>& placed = std::nullopt);

/// Strength of the lamp as a white target of known reflectance showed it.
struct WhiteReference {
  Eigen::Array3d strength = Eigen::Array3d::Ones();  ///< [W/sr] near, [W/m²] distant, at power 1
  Eigen::Array3d sigma = Eigen::Array3d::Zero();     ///< relative standard error
  Eigen::Array3d reflectance = Eigen::Array3d::Ones();  ///< of the target, as given
  bool near = true;                                     ///< unit of the strength
  std::string session;                                  ///< that it was measured in
  int samples = 0;
};

/// What `lightrig calibrate white` writes (schema "lightrig.white/1"), dated and hashed alike.
std::string white_reference_text(const WhiteReference& white, const std::string& date);

/// Takes intrinsics and distortion from a calibration file, and the camera's pose where it states
/// one; whether it does. Errors: invalid_input for a file that is none, was changed since, or
/// speaks of another picture size; not_found. The message does not name the file.
Result<bool> apply_camera_calibration(const std::filesystem::path& file, CameraConfig& camera);

/// Takes the lamp's strength from a white reference; the scale is then absolute. Errors as above.
Result<void> apply_white_reference(const std::filesystem::path& file, bool near, LampConfig& lamp);

}  // namespace lightrig
