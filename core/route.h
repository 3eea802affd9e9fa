#pragma once

#include <span>
#include <vector>

#include "core/gantry_model.h"

namespace lightrig {

/// Order in which to visit stops from `start` for the least total move time; indices into `stops`.
/// Exact (dynamic programming over subsets) up to 12 stops, beyond that nearest neighbour improved
/// by 2-opt and or-opt moves. Deterministic, coincident stops included.
std::vector<int> order_route(const GantryModel& gantry, const GantryPosition& start,
                             std::span<const GantryPosition> stops);

/// Total move time [s] of a route from `start`.
double route_time(const GantryModel& gantry, const GantryPosition& start,
                  std::span<const GantryPosition> stops, std::span<const int> order);

}  // namespace lightrig
