#include "sim/gantry_dynamics.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <utility>

#include "core/check.h"

namespace lightrig::sim {
namespace {

double seconds_between(TimePoint from, TimePoint to) {
  return std::chrono::duration<double>(to - from).count();
}

/// Entries of the transition matrix of y″ + 2ζω y′ + ω² y = 0 over t seconds:
/// y(t) = yy·y + yv·y′, y′(t) = vy·y + vv·y′.
struct Transition {
  double yy = 1, yv = 0, vy = 0, vv = 1;
};

// Underdamped: e^(−ζωt) times sines and cosines of ω_d = ω√(1 − ζ²).
Transition underdamped(double omega, double zeta, double t) {
  const double decay = zeta * omega;
  const double omega_d = omega * std::sqrt((1 - zeta) * (1 + zeta));
  const double envelope = std::exp(-decay * t);
  const double c = envelope * std::cos(omega_d * t);
  const double s = omega_d * t > 1e-8 ? envelope * std::sin(omega_d * t) / omega_d : envelope * t;
  return {c + decay * s, s, -omega * omega * s, c - decay * s};
}

// Overdamped: two real decays r₁ ≤ r₂. r₁ is ω²/r₂, because ζω − β would cancel; nothing overflows,
// because only decaying exponentials are formed.
Transition overdamped(double omega, double zeta, double t) {
  const double beta = omega * std::sqrt((zeta - 1) * (zeta + 1));
  const double r2 = zeta * omega + beta;
  const double r1 = omega * omega / r2;
  const double e1 = std::exp(-r1 * t);
  const double s = beta * t > 1e-12 ? e1 * -std::expm1(-2 * beta * t) / (2 * beta) : e1 * t;
  const double vv = beta * t > 0.5 ? (r2 * std::exp(-r2 * t) - r1 * e1) / (2 * beta) : e1 - r2 * s;
  return {e1 + r1 * s, s, -omega * omega * s, vv};
}

}  // namespace

ArmState arm_after(const ArmModel& arm, ArmState state, double base_acceleration, double t) {
  if (arm.frequency <= 0) return {};
  const double omega = 2 * std::numbers::pi * arm.frequency;
  const Transition transition =
      arm.damping < 1 ? underdamped(omega, arm.damping, t) : overdamped(omega, arm.damping, t);
  const double hang = -base_acceleration / (omega * omega);  // where the arm would come to rest
  const double y = state.deflection - hang;
  return {hang + transition.yy * y + transition.yv * state.rate,
          transition.vy * y + transition.vv * state.rate};
}

GantryDynamics::GantryDynamics(GantryModel gantry, ArmModel arm, GantryPosition start,
                               TimePoint now)
    : gantry_(std::move(gantry)),
      arm_(arm),
      start_(now),
      position_(start.axes),
      velocity_(AxisValues::Zero(start.axes.size())),
      arms_(static_cast<std::size_t>(start.axes.size())),
      rest_(start.axes) {
  CHECK(start.axes.size() == static_cast<Eigen::Index>(gantry_.axes.size()));
}

TimePoint GantryDynamics::move(TimePoint now, const GantryPosition& to, double speed_share) {
  CHECK(speed_share > 0 && speed_share <= 1);
  restart(now);
  const GantryPosition from{add_braking()};
  GantryModel slowed = gantry_;
  for (Axis& axis : slowed.axes) axis.max_speed *= speed_share;
  const MoveProfile profile = move_profile(slowed, from, to);
  const AxisValues pull = (to.axes - from.axes) * profile.acceleration;
  add_segment(profile.ramp_time, pull);
  add_segment(profile.cruise_time, AxisValues::Zero(pull.size()));
  add_segment(profile.ramp_time, -pull);
  rest_ = to.axes;
  return end();
}

TimePoint GantryDynamics::halt(TimePoint now) {
  restart(now);
  rest_ = add_braking();
  return end();
}

GantryMotionState GantryDynamics::at(TimePoint time) const { return evolved(time).state; }

void GantryDynamics::displace(const AxisValues& by) {
  position_ += by;
  rest_ += by;
}

/// Makes `now` the start of the description, with the state the old one has come to.
void GantryDynamics::restart(TimePoint now) {
  Evolved current = evolved(now);
  position_ = rest_ = current.state.position;
  velocity_ = current.state.velocity;
  arms_ = std::move(current.arms);
  segments_.clear();
  start_ = now;
}

void GantryDynamics::add_segment(double duration, const AxisValues& acceleration) {
  if (duration > 0) segments_.push_back({duration, acceleration});
}

/// Adds the segment that brings moving drives to rest, all together, and returns where.
AxisValues GantryDynamics::add_braking() {
  double duration = 0;
  for (std::size_t i = 0; i < gantry_.axes.size(); ++i) {
    const double speed = std::abs(velocity_[static_cast<Eigen::Index>(i)]);
    duration = std::max(duration, speed / gantry_.axes[i].max_acceleration);
  }
  if (!(duration > 0)) return position_;
  add_segment(duration, -velocity_ / duration);
  return position_ + velocity_ * (duration / 2);
}

TimePoint GantryDynamics::end() const {
  double total = 0;
  for (const Segment& segment : segments_) total += segment.duration;
  // One nanosecond more than the rounded-up sum, so that the drives surely are at rest then.
  const double whole = std::ceil(total * 1e9) + 1;
  return total > 0 ? start_ + std::chrono::nanoseconds(std::llround(whole)) : start_;
}

GantryDynamics::Evolved GantryDynamics::evolved(TimePoint time) const {
  double left = std::max(0.0, seconds_between(start_, time));
  Evolved now{{position_, velocity_, AxisValues::Zero(position_.size()), false}, arms_};
  GantryMotionState& state = now.state;
  const auto advance_arms = [&](double t, const AxisValues& acceleration) {
    for (std::size_t i = 0; i < now.arms.size(); ++i) {
      const double a = acceleration[static_cast<Eigen::Index>(i)];
      now.arms[i] = arm_after(arm_, now.arms[i], a, t);
    }
  };
  for (const Segment& segment : segments_) {
    state.moving = left < segment.duration;
    const double t = std::min(left, segment.duration);
    state.position += state.velocity * t + segment.acceleration * (t * t / 2);
    state.velocity += segment.acceleration * t;
    advance_arms(t, segment.acceleration);
    left -= t;
    if (state.moving) break;
  }
  if (!state.moving) {
    // The sums above are off by rounding; the drives stand on their target.
    state.position = rest_;
    state.velocity.setZero();
    if (left > 0) advance_arms(left, AxisValues::Zero(position_.size()));
    const double omega = 2 * std::numbers::pi * arm_.frequency;
    double amplitude = 0;
    for (const ArmState& arm : now.arms) {
      if (arm_.frequency > 0) amplitude = std::hypot(amplitude, arm.deflection, arm.rate / omega);
    }
    if (amplitude < arm_rest_amplitude) now.arms.assign(now.arms.size(), ArmState{});
  }
  for (std::size_t i = 0; i < now.arms.size(); ++i) {
    state.deflection[static_cast<Eigen::Index>(i)] = now.arms[i].deflection;
  }
  return now;
}

}  // namespace lightrig::sim
