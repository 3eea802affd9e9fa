#pragma once

#include <string>
#include <vector>

#include "daemon/session/prepare.h"
#include "daemon/session/reduction.h"
#include "daemon/session/session_result.h"

namespace lightrig {

/// What the scene did not need: the plan's lines, then what the capture and the fit left out.
std::vector<LeftOutLine> left_out_lines(const SessionRecord& record, const Prepared& prepared,
                                        const BrdfBasis& basis);

/// What a person should know before using a result: remarks of preparation, nominal scale, clipped
/// and saturated data, lights planned and not captured, a held-out light that contradicts the
/// prediction.
std::vector<std::string> warnings_of(const SessionRecord& record, const Prepared& prepared,
                                     const SessionResult& result);

/// What to know of a pseudo-inverse whose rows have less than full rank; else empty. MAP, with its
/// prior, always has an answer.
std::string rank_loss(Estimator estimator, int rank, int components);

/// Per light: what was planned of it, what came of it.
std::vector<LightResult> light_results(const Reduction& reduction, const Plan& plan);

/// What the journal says of lights chosen anew, in order.
std::vector<ReplanNote> replans_of(const SessionRecord& record);

/// Why the capture ended where it did, in one sentence.
std::string stop_fired(const SessionRecord& record);

/// Whether the journal or the rig says that the devices were simulated in memory.
bool simulated(const SessionRecord& record);

/// Where the time on the rig went, as the journal measured it: homing, dark frames, exposing (lamp
/// on and ambient), and what is left of the lights: moving, settling, lamp, readout, storing.
std::vector<StageCost> capture_cost(const SessionRecord& record);

std::string describe(Estimator estimator, Eigen::Index components);
std::string describe(const LogMapping& mapping);
std::string describe(Criterion criterion);
std::string describe(const Plan& plan);

}  // namespace lightrig
