#pragma once

#include <limits>
#include <span>
#include <string>
#include <vector>

#include "config/controller_profile.h"
#include "config/rig.h"
#include "config/section.h"

namespace lightrig {

/// What no key can say alone: limits that contradict each other, axes that are missing, outputs
/// that the controller does not have. `root` is a rig file as read; `profile` is the controller
/// profile it names, or nullptr where there is none or it could not be read.
void check_rig(const Section& root, const ControllerProfile* profile, Findings& findings);

/// Axes that this kind of kinematics may have, in the order of GantryPosition.
std::vector<std::string> axes_of_kinematics(const std::string& kinematics);

/// Exposures that the camera can take [s].
struct ExposureRange {
  double least = 0, most = std::numeric_limits<double>::infinity();
};

/// The same for the tables of a session: those of the session file or, where it has none, of the
/// rig file.
void check_session(std::span<const Section* const> tables, const ExposureRange& camera,
                   Findings& findings);

/// What these tables name on disk: mesh, materials, reference, a simulated material.
void check_named_files(std::span<const Section* const> tables, Findings& findings);

/// Whether a simulated material is a file's path rather than a name of the built-in set.
bool names_a_file(const std::string& material);

/// The rig that a file without errors describes; session defaults, path and text left to the
/// caller.
Rig make_rig(const Section& root, const ControllerProfile* profile);

/// The session that these tables describe; absent ones leave the spec's own defaults.
SessionSpec make_session(std::span<const Section* const> tables);

}  // namespace lightrig
