#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include "config/rig.h"
#include "core/pose_fit.h"
#include "daemon/session/prepare.h"

namespace lightrig {

/// Where a planned light's highlight is expected in the picture.
struct ExpectedHighlight {
  int shot = 0;           ///< index into Plan::shots
  Eigen::Vector2d pixel;  ///< [px] of the camera's picture: where the half vector meets the normal
  double off = 0;         ///< [rad] θh there; large where the object has no such normal in sight
};

/// One for every planned light that lights anything in sight; on a turntable those of the lights
/// that are planned at the turn it is homed to.
std::vector<ExpectedHighlight> expected_highlights(const Rig& rig, const Prepared& prepared);

/// A picture of the rig (PNG, the camera's aspect, any size) with the modelled object's outline in
/// green and a ring where each planned light's highlight is expected, so that a person sees a wrong
/// pose. Errors: invalid_input for what is no PNG or has another aspect.
Result<std::vector<std::byte>> overlay_png(const std::string& png, const Rig& rig,
                                           const Prepared& prepared);

/// How the object lies in such a picture, lit from where the gantry stands: the figure that a
/// session checks at its start [pose_check.h], from an eighth of the tones. Errors: as of
/// overlay_png().
Result<PoseFit> pose_in_preview(const std::string& png, const Rig& rig, const Prepared& prepared,
                                const GantryPosition& at);

}  // namespace lightrig
