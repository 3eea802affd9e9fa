#pragma once

#include <vector>

#include "core/gantry_model.h"
#include "drivers/clock.h"

namespace lightrig::sim {

/// Deflection of the arm along one axis against its drive, [rad] or [m], and its rate [per s].
struct ArmState {
  double deflection = 0;
  double rate = 0;
};

/// A lightly damped arm: q″ + 2ζω q′ + ω² q = −a, driven by the acceleration a of its base.
struct ArmModel {
  double frequency = 0;  ///< [Hz] undamped natural frequency; 0 = rigid, never deflected
  double damping = 0;    ///< ratio ζ ≥ 0
};

/// The arm after t seconds of constant base acceleration, in closed form (under-, critically and
/// overdamped): exact and stable at any step, however stiff; no step size exists.
ArmState arm_after(const ArmModel& arm, ArmState state, double base_acceleration, double t);

/// Where the drives and the arm are at one moment.
struct GantryMotionState {
  AxisValues position;    ///< of the drives: what their encoders read
  AxisValues velocity;    ///< of the drives
  AxisValues deflection;  ///< of the arm; zero once the arm has come to rest
  bool moving = false;    ///< the drives are
};

/// Drives that follow acceleration-limited straight moves in axis space, carrying an elastic arm.
/// State is a closed-form function of time since the last command: asking often or seldom makes no
/// difference.
class GantryDynamics {
 public:
  /// Below this amplitude, in axis units [rad or m], friction holds the arm: it counts as at rest
  /// exactly, so that a settled exposure does not depend on the nanosecond it was taken in. A third
  /// of a usual arrival tolerance.
  static constexpr double arm_rest_amplitude = 1e-4;

  GantryDynamics(GantryModel gantry, ArmModel arm, GantryPosition start, TimePoint now);

  /// Starts a move; drives in motion first slow down to rest. `speed_share` in (0, 1] scales speed
  /// (homing is slow). Returns when the drives will be at rest.
  TimePoint move(TimePoint now, const GantryPosition& to, double speed_share = 1);

  /// Slows down to rest along the way it is going. Returns when the drives will be at rest.
  TimePoint halt(TimePoint now);

  GantryMotionState at(TimePoint time) const;

  /// Shifts where the drives are, and with it where they will end, by so much [rad or m]: a belt
  /// that jumped. Speeds stay as they are.
  void displace(const AxisValues& by);

  /// Where the drives are, or are going.
  const AxisValues& destination() const { return rest_; }

 private:
  struct Segment {
    double duration = 0;      // [s]
    AxisValues acceleration;  // constant over the segment
  };
  struct Evolved {
    GantryMotionState state;
    std::vector<ArmState> arms;
  };
  Evolved evolved(TimePoint time) const;
  void restart(TimePoint now);
  void add_segment(double duration, const AxisValues& acceleration);
  AxisValues add_braking();
  TimePoint end() const;

  GantryModel gantry_;
  ArmModel arm_;
  TimePoint start_;
  AxisValues position_, velocity_;  // of the drives at start_
  std::vector<ArmState> arms_;      // at start_
  std::vector<Segment> segments_;
  AxisValues rest_;  // where the segments end, exactly
};

}  // namespace lightrig::sim
