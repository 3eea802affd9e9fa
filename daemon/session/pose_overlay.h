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

/// Of every planned light one, or why there is none.
struct ExpectedHighlights {
  std::vector<ExpectedHighlight> seen;
  std::vector<int> at_another_turn;  ///< shots: the turntable stands more than half a degree off
  std::vector<int> lights_nothing;   ///< shots: nothing in sight is lit
};
/// `at`: where the gantry stands; a turntable shows the object as it is turned there.
ExpectedHighlights expected_highlights(const Rig& rig, const Prepared& prepared,
                                       const GantryPosition& at);

/// A picture of the rig (PNG, the camera's aspect, any size) taken with the gantry there, with the
/// modelled object's outline in green and a ring with the light's name where each planned light's
/// highlight is expected, orange if fitted and blue if held out, so that a person sees a wrong
/// pose. Errors: invalid_input for what is no PNG or has another aspect.
Result<std::vector<std::byte>> overlay_png(const std::string& png, const Rig& rig,
                                           const Prepared& prepared, const GantryPosition& at);

/// How the object lies in such a picture, lit from where the gantry stands: the figure that a
/// session checks at its start [pose_check.h], from an eighth of the tones. Errors: as of
/// overlay_png().
Result<PoseFit> pose_in_preview(const std::string& png, const Rig& rig, const Prepared& prepared,
                                const GantryPosition& at);

}  // namespace lightrig
