#include "core/route.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <numbers>
#include <numeric>
#include <random>

namespace lightrig {
namespace {

GantryModel dome() {
  GantryModel gantry;
  gantry.kinematics = DomeKinematics{Eigen::Vector3d::Zero(), 1.0};
  gantry.axes = {{"azimuth", true, -4, 4, 0.5, 1.0, 0.0}, {"elevation", true, 0, 1.5, 0.2, 0.5, 0}};
  return gantry;
}

std::vector<GantryPosition> random_stops(int count, unsigned seed) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> a(-4, 4), e(0, 1.5);
  std::vector<GantryPosition> stops(static_cast<std::size_t>(count));
  for (GantryPosition& stop : stops) stop.axes = Eigen::Vector2d(a(random), e(random));
  return stops;
}

GantryPosition home() {
  GantryPosition position;
  position.axes = Eigen::Vector2d(0, 0);
  return position;
}

bool visits_each_once(std::vector<int> order, std::size_t stops) {
  std::sort(order.begin(), order.end());
  std::vector<int> all(stops);
  std::iota(all.begin(), all.end(), 0);
  return order == all;
}

TEST(OrderRoute, IsTheBestOfAllPermutations) {
  const GantryModel gantry = dome();
  for (unsigned seed = 0; seed < 30; ++seed) {
    const auto stops = random_stops(1 + static_cast<int>(seed % 8), seed);
    std::vector<int> permutation(stops.size());
    std::iota(permutation.begin(), permutation.end(), 0);
    double best = 1e300;
    do {
      best = std::min(best, route_time(gantry, home(), stops, permutation));
    } while (std::next_permutation(permutation.begin(), permutation.end()));
    const std::vector<int> order = order_route(gantry, home(), stops);
    EXPECT_TRUE(visits_each_once(order, stops.size()));
    EXPECT_NEAR(route_time(gantry, home(), stops, order), best, 1e-12 * best) << "seed " << seed;
  }
}

TEST(OrderRoute, TwelveStopsAreStillExact) {
  // Stops on a line, shuffled: the best route is known without search.
  const GantryModel gantry = dome();
  std::vector<GantryPosition> stops(12);
  const std::vector<int> shuffled{7, 2, 11, 0, 5, 9, 3, 1, 10, 4, 8, 6};
  for (std::size_t i = 0; i < stops.size(); ++i) {
    stops[i].axes = Eigen::Vector2d(0.3 * (1 + shuffled[i]), 0.0);
  }
  const std::vector<int> order = order_route(gantry, home(), stops);
  for (std::size_t i = 0; i < order.size(); ++i) {
    EXPECT_EQ(shuffled[static_cast<std::size_t>(order[i])], static_cast<int>(i));
  }
}

TEST(OrderRoute, LongRoutesVisitAllAndCannotBeBetteredByOneSwapOrReversal) {
  const GantryModel gantry = dome();
  for (unsigned seed = 0; seed < 5; ++seed) {
    const auto stops = random_stops(40, 100 + seed);
    const std::vector<int> order = order_route(gantry, home(), stops);
    ASSERT_TRUE(visits_each_once(order, stops.size()));
    const double time = route_time(gantry, home(), stops, order);
    std::vector<int> identity(stops.size());
    std::iota(identity.begin(), identity.end(), 0);
    EXPECT_LT(time, 0.5 * route_time(gantry, home(), stops, identity));
    for (std::size_t i = 0; i < order.size(); ++i) {
      for (std::size_t j = i + 1; j < order.size(); ++j) {
        std::vector<int> other = order;
        std::reverse(other.begin() + static_cast<std::ptrdiff_t>(i),
                     other.begin() + static_cast<std::ptrdiff_t>(j) + 1);
        EXPECT_GE(route_time(gantry, home(), stops, other), time * (1 - 1e-9));
      }
    }
  }
}

TEST(OrderRoute, TheHeuristicIsNearTheExactRouteOnItsOwnGround) {
  // Thirteen stops, one of them twice: the exact route of the twelve distinct ones is the optimum.
  const GantryModel gantry = dome();
  double worst = 0;
  for (unsigned seed = 0; seed < 20; ++seed) {
    auto stops = random_stops(12, 500 + seed);
    const double exact = route_time(gantry, home(), stops, order_route(gantry, home(), stops));
    stops.push_back(stops[4]);
    const std::vector<int> order = order_route(gantry, home(), stops);
    ASSERT_TRUE(visits_each_once(order, stops.size()));
    const double time = route_time(gantry, home(), stops, order);
    EXPECT_GE(time, exact * (1 - 1e-12));
    worst = std::max(worst, time / exact);
  }
  EXPECT_LT(worst, 1.15);
}

TEST(OrderRoute, CoincidentStopsEndAndKeepTheirOrder) {
  const GantryModel gantry = dome();
  for (const std::size_t count : {5U, 12U, 30U}) {
    std::vector<GantryPosition> stops(count);
    for (GantryPosition& stop : stops) stop.axes = Eigen::Vector2d(1, 1);
    const std::vector<int> order = order_route(gantry, home(), stops);
    EXPECT_TRUE(visits_each_once(order, count));
    EXPECT_EQ(order, order_route(gantry, home(), stops));
  }
  EXPECT_TRUE(order_route(gantry, home(), {}).empty());
}

}  // namespace
}  // namespace lightrig
