#pragma once

#include <cstddef>
#include <optional>
#include <span>

#include "core/pose_fit.h"

namespace lightrig {

/// What the lights of a session say of the pose together.
struct PoseOpinion {
  bool decided = false;               ///< no further light needs to be asked
  std::size_t by = 0;                 ///< the look to go by, decided or not
  std::optional<std::size_t> second;  ///< the look that agrees that the pose is wrong
};

/// Whether a light that was asked after `first`, which says that the pose is wrong, sees the same:
/// at least half of what is tolerated, along the same motion.
bool agrees(const PoseFit& first, const PoseFit& next);

/// An opinion from looks in the order of their lights, at least one. A light that says that all is
/// well is believed. One that says that the pose is wrong is believed when a second one agrees:
/// where a mirror shows what no free reflectance explains, the pose is bent to explain it, at every
/// light another way; an object that lies wrong does so at every light alike. A light that shows
/// nothing of the motion in question neither agrees nor clears. Undecided, the first light in doubt
/// is gone by.
PoseOpinion opinion(std::span<const PoseFit> looks);

}  // namespace lightrig
