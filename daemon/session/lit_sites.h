#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "config/rig.h"
#include "core/image.h"
#include "daemon/session/prepare.h"

namespace lightrig {

/// A point of the object that the lamp lights and a site sees.
struct LitPoint {
  std::size_t site = 0;  ///< row · width + column
  Eigen::Vector3d x, n;  ///< [m], world; unit normal
  Eigen::Vector3d wo;    ///< unit, towards the camera
};
/// The points that planning looks at in this shot of the plan that are lit, unshadowed and within
/// the grazing limits.
std::vector<LitPoint> lit_points(const Rig& rig, const SessionSpec& spec, const Prepared& prepared,
                                 int shot);

/// Sensor sites (height · width) at which a sample will be taken in this shot of the plan: 1 where
/// there is a lit point.
std::vector<std::uint8_t> lit_sites(const Rig& rig, const std::vector<LitPoint>& lit);
std::vector<std::uint8_t> lit_sites(const Rig& rig, const SessionSpec& spec,
                                    const Prepared& prepared, int shot);

/// How a frame of a scene compares with an earlier one of the same scene at the same exposure.
struct FrameLikeness {
  double ratio = 1;    ///< median of counts now over counts then, above black
  double strayed = 0;  ///< [0, 1] share of the sites that differ by more than their noise explains
  int sites = 0;       ///< compared: lit, well above black, not saturated both times
};
FrameLikeness compare_frames(const Frame& then, const Frame& now,
                             const std::vector<std::uint8_t>& sites, const SensorModel& sensor);

}  // namespace lightrig
