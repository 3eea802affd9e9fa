#pragma once

#include <cstdint>
#include <numbers>
#include <span>
#include <vector>

#include "daemon/session/prepare.h"

namespace lightrig {

/// The shot of a chosen candidate.
Shot shot_at(const Prepared& prepared, const SessionSpec& spec, const SelectedLight& selected);

/// The quickest way round; but a session that may stop early takes its lights by worth, after the
/// held-out ones, so that whenever it stops it has the best of the plan and something to test it
/// by.
std::vector<int> visiting_order(const Rig& rig, const SessionSpec& spec, const Plan& plan);
bool may_stop_early(const SessionSpec& spec);

/// The percentage error predicted of MAP after each shot of the way, in the way's order: not the
/// plan's own figures, which are in the order of choosing. A held-out shot changes nothing.
std::vector<double> predicted_on_the_way(const Prepared& prepared);

/// [rad] 10° from every other light, where there are such.
inline constexpr double held_out_distance = std::numbers::pi / 18;
/// Angle between two lamp positions as the object's middle sees them [rad].
double angle_between(const LightPosition& a, const LightPosition& b, const Eigen::Vector3d& middle);

/// Lights that are captured to test the result and never fitted: drawn with the seed from those
/// that show at least half as many cells as the richest candidate and, where there are such, stand
/// clear of every planned light, so that the test is not of a light just seen. `excluded`
/// (candidates, or empty): 1 = may not be chosen.
std::vector<int> choose_held_out(const Prepared& prepared, const SessionSpec& spec,
                                 std::span<const std::uint8_t> excluded);

/// Whether a shot of a plan that comes from a file is this session's: the file may be another
/// rig's, or changed by hand. The axes must put the lamp where extraction will believe it was, and
/// the exposures be ones this session offers. Errors: invalid_input.
Result<void> check_shot(const Rig& rig, const SessionSpec& spec, const Prepared& prepared,
                        const Shot& shot);

}  // namespace lightrig
