#pragma once

#include "config/controller_profile.h"
#include "config/section.h"

namespace lightrig {

/// Whether what the rig file says of wires fits together: a drive for every axis and none twice,
/// outputs and inputs that the controller has, one setting per line, limits the drive accepts.
void check_backends(const Section& root, const ControllerProfile* profile, Findings& findings);

}  // namespace lightrig
