#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numbers>

#include "core/route.h"
#include "sim/gantry_dynamics.h"
#include "study/stability_cases.h"
#include "study/stability_reference.h"

namespace lightrig {

std::vector<StabilityCase> motion_cases() {
  std::vector<StabilityCase> cases;
  // Deflection of the arm under a constant push of 1 s, from soft to a million times stiffer.
  for (const double frequency : {1e-3, 1.0, 1e3, 1e6}) {
    for (const double damping : {0.02, 5.0}) {
      const double t = 1.0 + 1e-7;
      const double reference = reference_arm(frequency, damping, 2.0, t);
      const sim::ArmState state = sim::arm_after({frequency, damping}, {}, 2.0, t);
      // The textbook integrator: explicit steps of a millisecond.
      double q = 0, rate = 0;
      const double w = 2 * std::numbers::pi * frequency;
      for (int i = 0; i < 1000; ++i) {
        const double a = -2.0 - 2 * damping * w * rate - w * w * q;
        q += 1e-3 * rate;
        rate += 1e-3 * a;
      }
      // The phase ωt itself is rounded: its error is εωt, of a deflection that has decayed.
      const double phase = w * t * std::exp(-std::min(700.0, damping * w * t));
      cases.push_back(
          judged("motion",
                 fmt::format("arm of {:.0e} Hz, damping {}, one step of 1 s", frequency, damping),
                 reference, state.deflection, q, 1e-9 + 1e-15 * phase));
    }
  }
  // A drive's ramp of half a second up and part of the way down; the arm from a thousandth of the
  // ramp's rate to a million times as fast. Superposed: the push at 0, less twice that at the turn.
  for (const double ratio : {1e-3, 1.0, 1e3, 1e6}) {
    const double ramp = 0.5, down = 0.2, frequency = ratio / ramp, damping = 0.02;
    const double reference = reference_arm(frequency, damping, 2.0, ramp + down) -
                             2 * reference_arm(frequency, damping, 2.0, down);
    const sim::ArmModel arm{frequency, damping};
    const sim::ArmState top = sim::arm_after(arm, {}, 2.0, ramp);
    const double w = 2 * std::numbers::pi * frequency;
    const double phase = w * (ramp + down) * std::exp(-std::min(700.0, damping * w * down));
    cases.push_back(judged(
        "motion", fmt::format("arm frequency times the drive's ramp of 0.5 s: {:.0e}", ratio),
        reference, sim::arm_after(arm, top, -2.0, down).deflection, -2.0 / (w * w),
        1e-9 + 1e-15 * phase));
  }
  GantryModel gantry;
  gantry.kinematics = DomeKinematics{Eigen::Vector3d::Zero(), 1.0};
  gantry.axes = {{"azimuth", true, -3, 3, 1, 2, 0}, {"elevation", true, 0, 1.5, 1, 2, 0}};
  const auto at = [](double a, double e) {
    GantryPosition p;
    p.axes = Eigen::Vector2d(a, e);
    return p;
  };
  std::vector<GantryPosition> stops = {at(1, 0.5), at(1, 0.5), at(1, 0.5), at(0, 0), at(0, 0)};
  const std::vector<int> order = order_route(gantry, at(0, 0), stops);
  std::vector<int> sorted = order;
  std::sort(sorted.begin(), sorted.end());
  cases.push_back(judged("route", "coincident stops: each is visited once", 1,
                         sorted == std::vector<int>{0, 1, 2, 3, 4} ? 1 : 0, no_naive, 0));
  // By hand: azimuth goes 1 rad at 1 rad/s and 2 rad/s², 1 + 1/2 s; elevation takes less. The
  // trapezoid's formula d/v + v/a, which knows no way of none, adds half a second for every stop.
  const double way = 1.5, nowhere = 0.5;
  cases.push_back(judged("route", "coincident stops: one move, no more", way,
                         route_time(gantry, at(0, 0), stops, order), way + 4 * nowhere, 1e-12));
  stops.assign(30, at(1, 0.5));
  cases.push_back(judged("route", "thirty stops in one place", way,
                         route_time(gantry, at(0, 0), stops, order_route(gantry, at(0, 0), stops)),
                         way + 29 * nowhere, 1e-12));
  // From 1e-12 rad to 1: below v²/a, an axis is never at full speed, 2 √(d/a).
  for (const double d : {1e-12, 1e-6, 0.25, 0.5, 1.0}) {
    const double reference = d < 0.5 ? 2 * std::sqrt(d / 2) : d + 0.5;
    cases.push_back(judged("route", fmt::format("a move of {:.0e} rad", d), reference,
                           move_time(gantry, at(0, 0), at(d, 0)), d + 0.5, 1e-12));
  }
  return cases;
}

}  // namespace lightrig
