#pragma once

#include <optional>
#include <string>

#include "cli/json_fields.h"
#include "daemon/session/pose_overlay.h"

namespace lightrig::cli {

/// How the object lies in a frame.
struct PoseSaid {
  std::string verdict;  ///< "as_modelled", "wrong", "not_told"
  std::string words;
};
/// `at`: where the gantry stands, where that is known. Told of a frame alone that was `just_lit`,
/// taken with the lamp.
PoseSaid pose_said(const std::string& png, const Rig& rig, const Prepared& prepared,
                   const std::optional<GantryPosition>& at, bool just_lit);

/// Planned lights whose highlight is not drawn, and why; "" where all are.
std::string not_drawn_words(const Plan& plan, const ExpectedHighlights& highlights);

/// All that `snap --overlay` says: highlights, not_drawn, pose, at_home (the gantry's position is
/// not known: drawn as at home).
Json overlay_json(const std::string& file, const Plan& plan, const ExpectedHighlights& highlights,
                  const PoseSaid& pose, bool at_home);

}  // namespace lightrig::cli
