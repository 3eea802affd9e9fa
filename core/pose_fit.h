#pragma once

#include <Eigen/Core>
#include <stop_token>
#include <vector>

#include "core/camera_model.h"
#include "core/light.h"
#include "core/mesh.h"
#include "core/occlusion.h"

namespace lightrig {

/// A picture of one colour under one lamp, proportional to radiance.
struct LitPicture {
  int width = 0, height = 0;    ///< [px], of the camera's
  std::vector<float> value;     ///< (height · width), any unit
  std::vector<float> variance;  ///< (height · width) the same squared; infinite: no value
};

/// By how much an object lies off its model, as far as a picture shows it. Vectors in the frame of
/// the mesh; turns about the middle of its box. The object's size is that box's longest edge.
struct PoseFit {
  bool told = false;  ///< enough of the object is lit and seen to judge by
  Eigen::Vector3d turn = Eigen::Vector3d::Zero();   ///< [rad] axis times angle
  Eigen::Vector3d shift = Eigen::Vector3d::Zero();  ///< [m]
  /// |(turn, shift)| in units of 1° and 2 % of the object's size, the expected value given that a
  /// pose is off by about one unit, along the motions that are seen: a sphere's turn is none.
  double off = 0;
  double sure = 0;  ///< `off` less its own standard error: by so much at least, most likely
  Eigen::Matrix<double, 6, 1> deviation =
      Eigen::Matrix<double, 6, 1>::Ones();  ///< [units] of the six principal motions, best seen
                                            ///< first; 1: not seen at all
  Eigen::Matrix<double, 6, 6> motion =
      Eigen::Matrix<double, 6, 6>::Identity();  ///< columns: those six, unit, in units: turn, shift
  double overlap = 1;      ///< [0, 1] of the object's outline as modelled and as found: area shared
                           ///< over area covered
  double unexplained = 1;  ///< [0, 1] share of the lit blocks that look unlike the model as found
  int blocks = 0;          ///< of pixels, lit, that were compared
  int seen_but_for_rims = 0;  ///< of the six: known to a third of a unit if rims lay exactly where
                              ///< they seem to
  /// Turn, then shift, in units: `turn` and `shift` as a vector of length `off`.
  Eigen::Matrix<double, 6, 1> judged = Eigen::Matrix<double, 6, 1>::Zero();

  int motions_seen() const;  ///< of the six: known to a third of a unit
  /// How much of a motion (turn, shift) [units] lies along those seen [units].
  double seen_of(const Eigen::Matrix<double, 6, 1>& motion) const;
  /// Standard error along a unit motion [units]; near 1: not seen.
  double deviation_along(const Eigen::Matrix<double, 6, 1>& direction) const;
};

inline constexpr int most_pose_blocks = 36000;

/// The pose at which the model looks most like the picture. What the surface does with light is not
/// known and is found with it, a free function of θh, its runs with θd and cos 2φd held loosely: so
/// that only where things are counts, not how bright. Gauss–Newton on the picture rendered with
/// shadows, robustly weighted [Huber 1964], the reflectance projected out [Golub & Pereyra 1973];
/// the covariance from the scatter of the score over parts of the picture [White 1980], since what
/// the model lacks is alike from block to block. Pictures are joined to blocks, about
/// `most_blocks`. What it returns once it was told to stop says nothing.
PoseFit fit_pose(const LitPicture& picture, const Mesh& mesh, const Occluder& occluder,
                 const CameraModel& camera, const LightPosition& light, int threads,
                 int most_blocks = most_pose_blocks, const std::stop_token& stop = {});

}  // namespace lightrig
