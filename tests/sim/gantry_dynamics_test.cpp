#include "sim/gantry_dynamics.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <random>

namespace lightrig::sim {
namespace {

using namespace std::chrono_literals;
constexpr double pi = std::numbers::pi;

GantryModel dome() {
  GantryModel gantry;
  gantry.kinematics = DomeKinematics{Eigen::Vector3d::Zero(), 0.5};
  gantry.axes = {{"azimuth", true, -3, 3, 0.8, 1.6, 0.0}, {"elevation", true, 0, 1.5, 0.5, 1.0, 0}};
  return gantry;
}

GantryPosition at(double a, double e) {
  GantryPosition position;
  position.axes = Eigen::Vector2d(a, e);
  return position;
}

TimePoint after(double s) { return TimePoint(std::chrono::nanoseconds(std::llround(s * 1e9))); }

/// Fourth-order Runge–Kutta in long double with a step far below every time constant: a second
/// method for the same equation.
ArmState by_small_steps(const ArmModel& arm, ArmState state, double a, double t, int steps) {
  const long double w = 2 * std::numbers::pi_v<long double> * arm.frequency, z = arm.damping;
  long double q = state.deflection, v = state.rate;
  const long double h = static_cast<long double>(t) / steps;
  const auto force = [&](long double x, long double rate) {
    return -static_cast<long double>(a) - 2 * z * w * rate - w * w * x;
  };
  for (int i = 0; i < steps; ++i) {
    const long double q1 = v, v1 = force(q, v);
    const long double q2 = v + h / 2 * v1, v2 = force(q + h / 2 * q1, v + h / 2 * v1);
    const long double q3 = v + h / 2 * v2, v3 = force(q + h / 2 * q2, v + h / 2 * v2);
    const long double q4 = v + h * v3, v4 = force(q + h * q3, v + h * v3);
    q += h / 6 * (q1 + 2 * q2 + 2 * q3 + q4);
    v += h / 6 * (v1 + 2 * v2 + 2 * v3 + v4);
  }
  return {static_cast<double>(q), static_cast<double>(v)};
}

TEST(ArmAfter, AgreesWithRungeKuttaWhateverTheDamping) {
  for (const double damping : {0.0, 0.03, 0.7, 0.999999, 1.0, 1.000001, 1.5, 20.0}) {
    const ArmModel arm{3.0, damping};
    const ArmState start{0.01, -0.2};
    for (const double t : {1e-4, 0.05, 0.4}) {
      const ArmState exact = arm_after(arm, start, 1.7, t);
      const ArmState stepped = by_small_steps(arm, start, 1.7, t, 20000);
      EXPECT_NEAR(exact.deflection, stepped.deflection, 1e-12) << damping << " " << t;
      EXPECT_NEAR(exact.rate, stepped.rate, 1e-10) << damping << " " << t;
    }
  }
}

TEST(ArmAfter, ManyStepsEqualOneStep) {
  std::mt19937 random(1);
  std::uniform_real_distribution<double> log_f(-2, 3), log_z(-4, 2), x(-1, 1);
  for (int i = 0; i < 500; ++i) {
    const ArmModel arm{std::pow(10, log_f(random)), std::pow(10, log_z(random))};
    const double omega = 2 * pi * arm.frequency;
    const ArmState start{x(random), omega * x(random)};
    ArmState many = start;
    for (int step = 0; step < 64; ++step) many = arm_after(arm, many, 2.0, 1.0 / 64);
    const ArmState once = arm_after(arm, start, 2.0, 1.0);
    const double scale = 1 + 2.0 / (omega * omega);
    // The phase ω t is itself rounded: ε ω t.
    EXPECT_NEAR(many.deflection, once.deflection, scale * (1e-13 + 1e-15 * 64 * omega));
    EXPECT_NEAR(many.rate / omega, once.rate / omega, scale * (1e-13 + 1e-15 * 64 * omega));
  }
}

TEST(ArmAfter, AnUndampedArmKeepsItsEnergyAndADampedOneOnlyLosesIt) {
  for (const double damping : {0.0, 1e-3, 0.05, 0.9, 1.0, 4.0, 1e6}) {
    const ArmModel arm{7.0, damping};
    const double omega = 2 * pi * arm.frequency;
    ArmState state{0.02, 0.3};
    const auto energy = [&](const ArmState& s) {
      return s.rate * s.rate / 2 + omega * omega * s.deflection * s.deflection / 2;
    };
    const double first = energy(state);
    double last = first;
    for (int step = 0; step < 2000; ++step) {
      state = arm_after(arm, state, 0, 0.0137);
      EXPECT_LE(energy(state), last * (1 + 1e-13));
      last = energy(state);
    }
    if (damping == 0) {
      EXPECT_NEAR(last, first, 1e-10 * first);
    }
  }
}

TEST(ArmAfter, StiffnessUpToAMillionNeitherBlowsUpNorForgetsTheStaticDeflection) {
  // Arm frequency against the time of the move from 1e-6 to 1e6, steps far longer than either.
  for (double ratio = 1e-6; ratio <= 1e6; ratio *= 10) {
    for (const double damping : {0.0, 0.01, 1.0, 100.0, 1e6}) {
      const ArmModel arm{ratio, damping};
      const double omega = 2 * pi * ratio;
      const ArmState state = arm_after(arm, {}, 1.0, 1e3);
      ASSERT_TRUE(std::isfinite(state.deflection) && std::isfinite(state.rate));
      // From rest under a steady push the arm swings between 0 and twice its static deflection.
      EXPECT_LE(std::abs(state.deflection), 2 / (omega * omega) * (1 + 1e-9));
      EXPECT_LE(std::abs(state.rate), 1 / omega * (1 + 1e-9));
      const double slowest = damping < 1 ? damping * omega : omega / (2 * damping);
      if (slowest * 1e3 > 50) {
        EXPECT_NEAR(state.deflection * omega * omega, -1, 1e-9) << ratio << " " << damping;
      }
    }
  }
}

TEST(ArmAfter, AnOverdampedCreepMatchesItsAsymptoticFormTo12Digits) {
  // ζ = 1e6: after the fast transient q = q0 e^(−r₁ t) (1 + …) with r₁ ≈ ω/2ζ; worked as a series.
  const ArmModel arm{1.0, 1e6};
  const double omega = 2 * pi, r1 = omega / 2e6 * (1 + 1 / (4e12));
  const ArmState state = arm_after(arm, {1.0, 0.0}, 0, 1e5);
  EXPECT_NEAR(state.deflection, std::exp(-r1 * 1e5) * (1 + 1 / 4e12), 1e-12);
  EXPECT_NEAR(state.rate / (-r1 * state.deflection), 1, 1e-10);
}

TEST(GantryDynamics, DrivesFollowTheMoveThatThePlannerPredicts) {
  const GantryModel gantry = dome();
  GantryDynamics dynamics(gantry, {}, at(0.2, 0.1), after(5));
  const TimePoint arrival = dynamics.move(after(5), at(1.9, 1.2));
  const double total = move_time(gantry, at(0.2, 0.1), at(1.9, 1.2));
  EXPECT_NEAR(std::chrono::duration<double>(arrival - after(5)).count(), total, 5e-9);
  for (int step = 0; step < 97; ++step) {
    const double t = total * step / 97;
    const AxisValues predicted = move_position(gantry, at(0.2, 0.1), at(1.9, 1.2), t).axes;
    EXPECT_LT((dynamics.at(after(5 + t)).position - predicted).norm(), 1e-8);
    EXPECT_TRUE(dynamics.at(after(5 + t)).moving);
  }
  EXPECT_FALSE(dynamics.at(arrival).moving);
  EXPECT_EQ(dynamics.at(arrival).position, at(1.9, 1.2).axes);
  EXPECT_TRUE(dynamics.at(arrival + 1h).deflection.isZero(0));
}

TEST(GantryDynamics, AskingOftenOrSeldomMakesNoDifference) {
  GantryDynamics seldom(dome(), {4.0, 0.05}, at(0, 0), after(0));
  GantryDynamics often = seldom;
  seldom.move(after(1), at(1, 1));
  often.move(after(1), at(1, 1));
  for (double t = 1; t < 4; t += 0.001) static_cast<void>(often.at(after(t)));
  EXPECT_EQ(seldom.at(after(4)).deflection, often.at(after(4)).deflection);
}

TEST(GantryDynamics, TheArmRingsAfterAMoveAndComesToRestExactly) {
  const ArmModel arm{3.0, 0.05};
  GantryDynamics dynamics(dome(), arm, at(0, 0), after(0));
  const TimePoint arrival = dynamics.move(after(0), at(1.0, 0.5));
  double largest = 0;
  for (int ms = 0; ms < 300; ++ms) {
    largest = std::max(largest, dynamics.at(arrival + ms * 1ms).deflection.norm());
  }
  const double static_deflection = 1.6 / std::pow(2 * pi * 3.0, 2);
  EXPECT_GT(largest, 0.3 * static_deflection);
  EXPECT_LT(largest, 6 * static_deflection);
  // Decays as e^(−ζωt): from `largest` below the rest amplitude, and then it is exactly zero.
  const double time =
      std::log(3 * largest / GantryDynamics::arm_rest_amplitude) / (0.05 * 2 * pi * 3);
  EXPECT_FALSE(dynamics.at(arrival + 500ms).deflection.isZero(0));
  const TimePoint quiet = arrival + std::chrono::nanoseconds(std::llround(time * 1e9));
  EXPECT_TRUE(dynamics.at(quiet).deflection.isZero(0));
}

TEST(GantryDynamics, HaltingBrakesWithinTheAccelerationLimitOnTheWayItWasGoing) {
  const GantryModel gantry = dome();
  GantryDynamics dynamics(gantry, {}, at(-2, 0.2), after(0));
  dynamics.move(after(0), at(2, 1.0));
  const GantryMotionState before = dynamics.at(after(1.5));
  const TimePoint rest = dynamics.halt(after(1.5));
  // Azimuth cruises at 0.8 rad/s and brakes at 1.6 rad/s²: half a second, 0.2 rad.
  EXPECT_NEAR(std::chrono::duration<double>(rest - after(1.5)).count(), 0.5, 1e-8);
  const GantryMotionState stopped = dynamics.at(rest);
  EXPECT_FALSE(stopped.moving);
  EXPECT_NEAR(stopped.position[0] - before.position[0], 0.2, 1e-9);
  EXPECT_NEAR((stopped.position[1] - before.position[1]) * 4.0, 0.2 * 0.8, 1e-9);
  EXPECT_TRUE(stopped.velocity.isZero(0));
}

TEST(GantryDynamics, ANewTargetInMotionBrakesFirstAndArrives) {
  GantryDynamics dynamics(dome(), {5.0, 0.1}, at(0, 0), after(0));
  dynamics.move(after(0), at(2, 1));
  const TimePoint arrival = dynamics.move(after(1), at(-1, 0.5));
  AxisValues last = dynamics.at(after(1)).position;
  for (double t = 1.001; after(t) < arrival; t += 0.001) {
    const AxisValues here = dynamics.at(after(t)).position;
    EXPECT_LE(std::abs(here[0] - last[0]), 0.8 * 0.001 * 1.001);  // no jump
    last = here;
  }
  EXPECT_EQ(dynamics.at(arrival).position, at(-1, 0.5).axes);
}

}  // namespace
}  // namespace lightrig::sim
