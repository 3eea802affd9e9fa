#pragma once

#include <Eigen/Core>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "config/calibration_file.h"
#include "core/calibrate_camera.h"
#include "core/result.h"

namespace lightrig {

/// A camera calibration with what became of every image.
struct CalibrationRun {
  CameraCalibration calibration;
  std::vector<MadeFrom> used;        ///< (views) images that the target was found in
  std::vector<std::string> skipped;  ///< one sentence for each reason not to use images
  std::optional<TargetInRig> placed;
  std::vector<std::string> warnings;  ///< what is accepted and should be looked at
  std::string text;                   ///< of the file to be written
};

/// Where the target lay in one of the images, in the rig's frame [rig_from_target].
struct BoardPlace {
  std::filesystem::path image;  ///< as among the images; empty: the first of them
  Eigen::Vector3d origin, columns, rows;
};

/// Calibrates a camera from pictures of a target, which states the camera's pose in the rig's frame
/// where `board` says where the target lay. Images without the target, and those given twice,
/// are passed over and said.
/// Errors: those of reading the pictures; invalid_input when their sizes differ, for a board placed
/// in an image that is none of them or that is passed over, for a checkerboard so placed, which
/// looks alike from both of its ends, and for markers that are not of the size given; refusals of
/// calibrate_camera(), with what was found where.
Result<CalibrationRun> calibrate_camera_from(const std::vector<std::filesystem::path>& images,
                                             const CalibrationTarget& target,
                                             const std::optional<BoardPlace>& board = std::nullopt);

struct WhiteRun {
  WhiteReference white;
  std::string text;  ///< of the file to be written
};

/// The lamp's strength from a session on a diffuse white target of known reflectance: its BRDF must
/// come out as reflectance/π. Samples away from the mirror direction and from grazing count.
/// Errors: those of reading the session; invalid_input for too few samples or a target that
/// scatters by more than 5 % about its mean, which is then not diffuse, or not where it was
/// modelled.
Result<WhiteRun> white_reference_from(const std::filesystem::path& session,
                                      const Eigen::Array3d& reflectance, int threads);

}  // namespace lightrig
