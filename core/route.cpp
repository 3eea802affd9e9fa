#include "core/route.h"

#include <algorithm>
#include <cstdint>
#include <limits>
#include <numeric>

namespace lightrig {
namespace {

constexpr int exact_up_to = 12;

/// Move times [s]: node 0 is the start, node i + 1 is stop i.
struct Times {
  int stops = 0;
  Eigen::MatrixXd between;  ///< (stops + 1 × stops + 1)
};

Times times_between(const GantryModel& gantry, const GantryPosition& start,
                    std::span<const GantryPosition> stops) {
  Times times;
  times.stops = static_cast<int>(stops.size());
  const Eigen::Index n = times.stops + 1;
  times.between = Eigen::MatrixXd::Zero(n, n);
  const auto node = [&](Eigen::Index i) -> const GantryPosition& {
    return i == 0 ? start : stops[static_cast<std::size_t>(i - 1)];
  };
  for (Eigen::Index i = 0; i < n; ++i) {
    for (Eigen::Index j = i + 1; j < n; ++j) {
      times.between(i, j) = times.between(j, i) = move_time(gantry, node(i), node(j));
    }
  }
  return times;
}

/// Held and Karp's dynamic programme for the open path: least(S, j) = time to have visited the set
/// S and stand at j ∈ S [Held, Karp 1962; Bellman 1962]. Smallest index on ties.
std::vector<int> exact_route(const Times& times) {
  const int n = times.stops;
  const std::uint32_t sets = 1U << n;
  const auto at = [n](std::uint32_t set, int j) {
    return static_cast<std::size_t>(set) * static_cast<std::size_t>(n) +
           static_cast<std::size_t>(j);
  };
  std::vector<double> least(static_cast<std::size_t>(sets) * static_cast<std::size_t>(n),
                            std::numeric_limits<double>::infinity());
  std::vector<int> before(least.size(), -1);
  for (int j = 0; j < n; ++j) least[at(1U << j, j)] = times.between(0, j + 1);
  for (std::uint32_t set = 1; set < sets; ++set) {
    for (int j = 0; j < n; ++j) {
      if ((set >> j & 1U) == 0) continue;
      const double reached = least[at(set, j)];
      for (int next = 0; next < n; ++next) {
        if ((set >> next & 1U) != 0) continue;
        const std::uint32_t larger = set | 1U << next;
        const double time = reached + times.between(j + 1, next + 1);
        if (time < least[at(larger, next)]) {
          least[at(larger, next)] = time;
          before[at(larger, next)] = j;
        }
      }
    }
  }
  std::uint32_t set = sets - 1;
  int last = 0;
  for (int j = 1; j < n; ++j) {
    if (least[at(set, j)] < least[at(set, last)]) last = j;
  }
  std::vector<int> order;
  while (last >= 0) {
    order.push_back(last);
    const int previous = before[at(set, last)];
    set &= ~(1U << last);
    last = previous;
  }
  std::reverse(order.begin(), order.end());
  return order;
}

std::vector<int> nearest_neighbour(const Times& times) {
  std::vector<std::uint8_t> visited(static_cast<std::size_t>(times.stops), 0);
  std::vector<int> order;
  int here = 0;
  for (int step = 0; step < times.stops; ++step) {
    int best = -1;
    for (int j = 0; j < times.stops; ++j) {
      if (visited[static_cast<std::size_t>(j)] != 0) continue;
      if (best < 0 || times.between(here, j + 1) < times.between(here, best + 1)) best = j;
    }
    visited[static_cast<std::size_t>(best)] = 1;
    order.push_back(best);
    here = best + 1;
  }
  return order;
}

/// Time from the stop (or start) at place i − 1 of the order to the one at place j; 0 past the open
/// end.
double leg(const Times& times, const std::vector<int>& order, int from_place, int to_place) {
  if (to_place >= times.stops) return 0;
  const int from = from_place < 0 ? 0 : order[static_cast<std::size_t>(from_place)] + 1;
  return times.between(from, order[static_cast<std::size_t>(to_place)] + 1);
}

/// Smaller savings are rounding: without this a cycle of equal routes would never end.
double worth_moving(const Times& times) { return 1e-12 * (1e-300 + times.between.maxCoeff()); }

/// One pass of 2-opt: reverses every stretch whose reversal shortens the path.
bool improve_by_reversal(const Times& times, std::vector<int>& order) {
  bool improved = false;
  const double least_saving = worth_moving(times);
  for (int i = 0; i < times.stops; ++i) {
    for (int j = i + 1; j < times.stops; ++j) {
      const double before = leg(times, order, i - 1, i) + leg(times, order, j, j + 1);
      double after = leg(times, order, i - 1, j);
      if (j + 1 < times.stops) after += leg(times, order, i, j + 1);
      if (before - after <= least_saving) continue;
      std::reverse(order.begin() + i, order.begin() + j + 1);
      improved = true;
    }
  }
  return improved;
}

/// One pass of or-opt: moves every run of one to three stops to where it shortens the path most.
bool improve_by_moving_runs(const Times& times, std::vector<int>& order) {
  bool improved = false;
  const double least_saving = worth_moving(times);
  for (int length = 1; length <= 3; ++length) {
    for (int first = 0; first + length <= times.stops; ++first) {
      const int last = first + length - 1;
      std::vector<int> rest = order;
      rest.erase(rest.begin() + first, rest.begin() + last + 1);
      const int left = static_cast<int>(rest.size());
      const int head = order[static_cast<std::size_t>(first)] + 1;
      const int tail = order[static_cast<std::size_t>(last)] + 1;
      const double gain = leg(times, order, first - 1, first) + leg(times, order, last, last + 1) -
                          (last + 1 < times.stops ? leg(times, order, first - 1, last + 1) : 0);
      int best_place = -1;
      double best_cost = gain - least_saving;
      for (int place = 0; place <= left; ++place) {
        const int before = place == 0 ? 0 : rest[static_cast<std::size_t>(place - 1)] + 1;
        double cost = times.between(before, head);
        if (place < left) {
          const int after = rest[static_cast<std::size_t>(place)] + 1;
          cost += times.between(tail, after) - times.between(before, after);
        }
        if (cost < best_cost) {
          best_cost = cost;
          best_place = place;
        }
      }
      if (best_place < 0) continue;
      rest.insert(rest.begin() + best_place, order.begin() + first, order.begin() + last + 1);
      order = rest;
      improved = true;
    }
  }
  return improved;
}

/// Nearest neighbour, then 2-opt and or-opt until neither helps [Croes 1958; Or 1976].
std::vector<int> improved_route(const Times& times) {
  std::vector<int> order = nearest_neighbour(times);
  constexpr int most_rounds = 1000;  // each round shortens the path; the limit is a promise to end
  for (int round = 0; round < most_rounds; ++round) {
    const bool reversed = improve_by_reversal(times, order);
    const bool moved = improve_by_moving_runs(times, order);
    if (!reversed && !moved) break;
  }
  return order;
}

}  // namespace

std::vector<int> order_route(const GantryModel& gantry, const GantryPosition& start,
                             std::span<const GantryPosition> stops) {
  if (stops.empty()) return {};
  const Times times = times_between(gantry, start, stops);
  return times.stops <= exact_up_to ? exact_route(times) : improved_route(times);
}

double route_time(const GantryModel& gantry, const GantryPosition& start,
                  std::span<const GantryPosition> stops, std::span<const int> order) {
  double sum = 0;
  const GantryPosition* here = &start;
  for (const int index : order) {
    const GantryPosition& next = stops[static_cast<std::size_t>(index)];
    sum += move_time(gantry, *here, next);
    here = &next;
  }
  return sum;
}

}  // namespace lightrig
