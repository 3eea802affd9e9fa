#pragma once

#include "config/rig.h"
#include "core/candidate_bins.h"
#include "daemon/session/patience.h"
#include "daemon/session/prepare.h"

namespace lightrig {

/// The bins of every candidate, each with the object as it then stands before the camera: on a
/// turntable one view for every turn, with a beat for each. `shadows` stands in for the session's
/// own.
BinningResult bin_views(const Rig& rig, const SessionSpec& spec, const Prepared& prepared,
                        ShadowRays shadows, int threads, const Patience& patience = {});

}  // namespace lightrig
