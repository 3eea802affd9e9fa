#pragma once

#include <nlohmann/json.hpp>

#include "config/rig.h"
#include "core/pose_fit.h"
#include "daemon/session/prepare.h"
#include "daemon/session/session_folder.h"

namespace lightrig {

/// Off by more than this, in the units of PoseFit::off, is a wrong pose: about half a degree, or a
/// hundredth of the object's size.
inline constexpr double pose_tolerance = 0.55;

/// An object of fewer pixels across is not judged.
inline constexpr double least_pose_pixels = 150;

/// Whether the object lies as [object] has it, from a captured shot's own frames. Not told where
/// the object is small in the picture, hardly lit, or does not look like the model at all. Errors:
/// those of reading the frames.
Result<PoseFit> check_pose(const Rig& rig, const Prepared& prepared, const SessionFolder& folder,
                           const CapturedShot& shot);

/// Fields of the journal's event "pose".
nlohmann::ordered_json pose_fields(const PoseFit& pose, const std::string& shot);

}  // namespace lightrig
