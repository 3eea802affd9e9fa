#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cstdint>

#include "core/camera_model.h"
#include "core/light.h"
#include "core/mesh.h"
#include "core/occlusion.h"

namespace lightrig {

/// What of the reflectance may be free in a picture under one lamp, where θd varies little: knots
/// even in √θh, fine at the highlight, of the mean over φd; fewer of its run with cos 2φd and with
/// θd; and a share of θd alone, for what shines back to the lamp. Then a constant on the object,
/// and one everywhere.
namespace pose_columns {
inline constexpr int mean_knots = 28, run_knots = 8;
inline constexpr int azimuth = mean_knots, tilt = azimuth + run_knots, back = tilt + run_knots,
                     object = back + run_knots, everywhere = object + 1, count = everywhere + 1;
}  // namespace pose_columns

/// Part of the picture that is looked at, joined to square blocks.
struct PoseBlocks {
  int edge = 1, left = 0, top = 0, across = 0, down = 0;  ///< [px], blocks

  int count() const { return across * down; }
};

/// What the blocks are made of at one pose: value = shares · (knots of the reflectance, constants).
struct PosePicture {
  Eigen::Matrix<float, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>
      shares;               ///< (blocks × pose_columns::count) of irradiance
  Eigen::VectorXf covered;  ///< (blocks) [0, 1] by the object
};

/// Pictures of a mesh in any pose near its own, with shadows and without a material.
class PoseRenderer {
 public:
  /// All are borrowed. Blocks cover the object's box in the picture with a margin, about `most` of
  /// them.
  PoseRenderer(const Mesh& mesh, const Occluder& occluder, const CameraModel& camera,
               const LightPosition& light, int most, int threads);

  const PoseBlocks& blocks() const { return blocks_; }
  /// With the object moved by `motion`, in the frame of the mesh. `grain` chooses where in a block
  /// the samples lie.
  PosePicture at(const Eigen::Isometry3d& motion, std::uint32_t grain = 0) const;

 private:
  struct Sight;
  struct Sample;
  Sample sample(const Sight& sight, double u, double v) const;
  void paint(const Sight& sight, int block, std::uint32_t grain, PosePicture& out) const;

  const Mesh& mesh_;
  const Occluder& occluder_;
  const CameraModel& camera_;
  const LightPosition& light_;
  PoseBlocks blocks_;
  int threads_;
  bool convex_;
  double middle_theta_d_ = 0;  ///< [rad] at the middle of the mesh …
  double spread_theta_d_ = 0;  ///< … and how far from that elsewhere
};

}  // namespace lightrig
