#pragma once

#include <Eigen/Core>
#include <vector>

#include "core/camera_model.h"
#include "core/light.h"
#include "core/mesh.h"
#include "core/occlusion.h"

namespace lightrig {

/// A picture of one colour under one lamp, proportional to radiance, without ambient light.
struct LitPicture {
  int width = 0, height = 0;    ///< [px], of the camera's
  std::vector<float> value;     ///< (height · width), any unit
  std::vector<float> variance;  ///< (height · width) the same squared; infinite: no value
};

/// By how much an object lies off its model. Turns are about the middle of the object's box,
/// vectors in the frame of the mesh.
struct PoseFit {
  bool told = false;  ///< enough of the object is lit to judge by, and the model explains it
  Eigen::Vector3d turn = Eigen::Vector3d::Zero();   ///< [rad] axis times angle
  Eigen::Vector3d shift = Eigen::Vector3d::Zero();  ///< [m]
  /// Of (turn, shift) in units of 1° and 2 % of the object's size. What the picture does not show,
  /// a sphere's turn about its middle, is not in them.
  Eigen::Matrix<double, 6, 1> off = Eigen::Matrix<double, 6, 1>::Zero();
  int directions_seen = 0;  ///< of the six
  double overlap = 1;      ///< [0, 1] of the object's outline as modelled and as found: area shared
                           ///< over area covered
  double unexplained = 0;  ///< rms of what the model leaves of the picture, of the picture's rms
  int blocks = 0;          ///< of pixels, that were compared
};

/// The pose at which the model looks most like the picture. What the surface does with light is not
/// known and is found with it: a free function of θh, so that only where things are counts, not how
/// bright. Gauss–Newton on the picture rendered with shadows, robustly weighted [Huber 1964], the
/// function of θh projected out [Golub & Pereyra 1973]. Pictures are joined to blocks of pixels,
/// about `most_blocks` on the object.
PoseFit fit_pose(const LitPicture& picture, const Mesh& mesh, const Occluder& occluder,
                 const CameraModel& camera, const LightPosition& light, int threads,
                 int most_blocks = 6000);

}  // namespace lightrig
