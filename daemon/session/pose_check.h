#pragma once

#include <algorithm>
#include <nlohmann/json.hpp>
#include <span>
#include <stop_token>
#include <string>
#include <vector>

#include "config/rig.h"
#include "core/pose_fit.h"
#include "daemon/session/journal.h"
#include "daemon/session/prepare.h"
#include "daemon/session/session_folder.h"

namespace lightrig {

/// Surely off by more than this, in the units of PoseFit::sure (1°, 2 % of the object's size), is a
/// wrong pose; by so much more for what the model leaves unexplained beyond a twentieth: where a
/// mirror shows what no free reflectance can, the pose is bent to explain it.
inline constexpr double pose_tolerance = 0.4, explained_well = 0.05, doubt_per_unexplained = 1.5;

/// An object of fewer pixels across is not judged; of a mosaic four sites make a pixel. With half
/// as many some right poses look a degree off.
inline constexpr double least_pose_pixels = 100;

/// A light that shows fewer motions tells too little, and the next one is asked. A sphere shows
/// three.
inline constexpr int fewest_motions = 3;

/// The longer side of the object's box in the picture [px].
double extent_in_picture(const Mesh& mesh, const CameraModel& camera);

/// Whether the object lies as [object] has it, from the frames of a shot of the plan: those lit by
/// its light, and the ones taken in the dark (may be empty). Not told where the object is small in
/// the picture or hardly lit, or shows fewer motions than `fewest_motions`. Errors: those of
/// merging, and stopped.
Result<PoseFit> judge_pose(const Rig& rig, const Prepared& prepared, int shot,
                           std::span<const Frame> lit, std::span<const Frame> dark,
                           const std::stop_token& stop = {});

/// The same of a captured shot's own frames. Errors: those of reading them too.
Result<PoseFit> check_pose(const Rig& rig, const Prepared& prepared, const SessionFolder& folder,
                           const CapturedShot& shot, const std::stop_token& stop = {});

/// Where more than this share of what is lit looks unlike the model in any pose nearby, the object
/// is another one, or lies far off.
inline constexpr double worst_unexplained = 0.3;

inline bool unlike_model(const PoseFit& pose) { return pose.unexplained > worst_unexplained; }
/// [units] of PoseFit::sure
inline double tolerated(const PoseFit& pose) {
  return pose_tolerance + doubt_per_unexplained * std::max(0.0, pose.unexplained - explained_well);
}
inline bool wrong(const PoseFit& pose) {
  return pose.told && (pose.sure > tolerated(pose) || unlike_model(pose));
}

/// The motions that the picture cannot show, in the frame of the mesh, best seen first: "a turn
/// about (0.00, 0.00, 1.00)". By none of them is a pose said to be right.
std::vector<std::string> unseen_motions(const PoseFit& pose);

/// The figure in words: "turned by 0.1° and shifted by 0.2 mm, outline overlapping by 99.8 %, 5 of
/// 6 motions seen, not a turn about (0.00, 0.00, 1.00)".
std::string in_words(const PoseFit& pose);

/// What a person is told of a wrong pose, and what to do: where a session waits for a person
/// ([pause] wrong_pose), or goes on.
std::string pose_reason(const PoseFit& pose, bool waits);

/// Fields of the journal's event "pose". `agreed_by`: the second shot that says it is wrong, or "".
nlohmann::ordered_json pose_fields(const PoseFit& pose, const std::string& shot, bool waits,
                                   const std::string& agreed_by = "");

/// What a report's reader is told of the event "pose": the reason of a wrong one, or which motions
/// no light showed; "" where there is nothing to say.
std::string pose_warning(const JournalEvent& event);

/// What a journal says of the pose. A shot that was taken back has to be looked at anew.
struct PoseStanding {
  bool looked = false;  ///< and told
  std::string held;     ///< why a person has to say whether to go on, and has not
};
PoseStanding pose_standing(std::span<const JournalEvent> events);

}  // namespace lightrig
