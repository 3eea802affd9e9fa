#pragma once

#include <cstdint>
#include <vector>

#include "config/rig.h"
#include "core/image.h"
#include "daemon/session/prepare.h"

namespace lightrig {

/// Sensor sites (height · width) at which a sample will be taken in this shot of the plan: 1 where
/// a point that planning looks at is lit, unshadowed and within the grazing limits.
std::vector<std::uint8_t> lit_sites(const Rig& rig, const SessionSpec& spec,
                                    const Prepared& prepared, int shot);

/// How a frame of a scene compares with an earlier one of the same scene at the same exposure.
struct FrameLikeness {
  double ratio = 1;    ///< median of counts now over counts then, above black
  double strayed = 0;  ///< [0, 1] share of the sites that differ by more than their noise explains
  int sites =
      0;  ///< compared: lit, well above black, not saturated both times; of 0 nothing is known
};
FrameLikeness compare_frames(const Frame& then, const Frame& now,
                             const std::vector<std::uint8_t>& sites, const SensorModel& sensor);

}  // namespace lightrig
