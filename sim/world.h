#pragma once

#include <cstdint>
#include <deque>
#include <map>
#include <mutex>
#include <optional>
#include <set>
#include <stop_token>
#include <string>
#include <utility>
#include <vector>

#include "config/rig.h"
#include "drivers/devices.h"
#include "sim/gantry_dynamics.h"
#include "sim/philox.h"
#include "sim/shading.h"

namespace lightrig::sim {

/// What the laboratory looked like at one moment: where everything really was.
struct SceneMoment {
  TimePoint time;
  GantryPosition drives;  ///< what the drives' encoders read
  bool moving = false;    ///< the drives were
  LightPosition light;    ///< where the lamp really was, in the world: arm deflection and position
                          ///< error included
  double turn = 0;        ///< [rad] how far a turntable had really turned the object
  double lamp_power = 0;  ///< [0, 1]
  double lamp_gain = 1;   ///< what the lamp gives of what it gave at first
};

/// What becomes of the camera's packets, from now on.
struct PacketWeather {
  std::uint64_t resent_per_frame = 0;  ///< lost and sent again
  std::uint64_t lost_per_frame = 0;    ///< lost for good, if any: the frame is rejected
};

/// The laboratory's own record of a frame, to judge what a session has written.
struct ExposureRecord {
  std::uint64_t frame_id = 0;
  double exposure = 0;  ///< [s]
  std::uint64_t repeat = 0;
  SceneMoment moment;         ///< at mid-exposure
  std::uint64_t content = 0;  ///< content_of() its counts
};

/// A number that tells pictures apart: FNV-1a over the counts.
std::uint64_t content_of(const RawImage& image);

/// The simulated laboratory: object, lamp on an elastic arm on a gantry, camera. In-memory devices
/// and the far ends of the wires are front ends to it. Commands return at once; waiting is the
/// front end's. Safe to call from several threads.
///
/// **What a frame's noise depends on**: (seed, position of the drives, lamp power, exposure, take,
/// repeat, site) and nothing else. `repeat` counts identical requests since the gantry was last
/// commanded, so that two dark frames in a row differ, while a shot done again from its move on is
/// the same to the byte, however many frames came before, in this process or another. That is what
/// makes a session that was killed and resumed equal to one that was not: it must redo from the
/// move whatever it had not journaled. `take` is for a deliberate second try (`retake`), whose
/// noise must be new: the session journals it and whoever made the world hands it to set_take().
/// The lamp's true position enters the picture exactly; once the arm has come to rest it is the
/// commanded one plus an error fixed by (seed, position), whatever the time.
class World {
 public:
  /// `object` is the true object (pose error included), `truth` its reflectance. `rig.simulation`
  /// must hold. The clock must outlive the world.
  World(const Rig& rig, Mesh object, Reflectance truth, Clock& clock, std::uint64_t seed,
        const RenderOptions& options);

  Clock& clock() const { return clock_; }
  const Rig& rig() const { return rig_; }

  // --- gantry. Refused: not homed, alarm, open interlock, beyond the soft limits.
  Result<TimePoint> start_homing();  ///< when it will be at rest, homed
  /// When it will be at rest; `speed_share` in (0, 1] of the axes' own speeds.
  Result<TimePoint> start_move(const GantryPosition& to, double speed_share = 1);
  /// One axis alone; the others keep their destination. A controller with a drive per axis commands
  /// them so.
  Result<TimePoint> start_axis_move(std::size_t axis, double to);
  /// The same for homing: the gantry is homed once every axis is. When those told so far will rest.
  Result<TimePoint> start_axis_homing(std::size_t axis);
  void halt_gantry();                    ///< decelerates and holds
  std::vector<TimePoint> halts() const;  ///< when a moving gantry was halted, by whomever
  /// One axis alone; the others go on to where they were going.
  void halt_axis(std::size_t axis);
  Result<void> clear_fault();  ///< Refused while an interlock is open.
  void lose_position();        ///< the controller no longer knows where it is: home again
  GantryStatus gantry_status() const;
  bool axis_homed(std::size_t axis) const;  ///< knows where it is, whatever the others do

  // --- lamp: a lease that goes dark by itself after max_on_time without renewal.
  Result<void> set_lamp(double power);  ///< Refused outside 0 … max_power.
  /// The same through an output at the end of a wire, which knows of no lease.
  Result<void> switch_lamp(double power);
  double lamp_power() const;

  // --- camera
  SceneMoment look() const;
  /// The frame taken at that moment. Errors: refused for an exposure out of range, stopped.
  Result<Frame> expose(const SceneMoment& moment, double exposure, const std::stop_token& stop);
  void set_take(std::uint64_t take);

  // --- accidents
  void set_interlock(const std::string& name, bool open);  ///< Opening halts the gantry.
  void raise_alarm(const std::string& text);               ///< Halts the gantry.
  /// An axis jumps by so much [rad or m]; its encoder sees it.
  void slip(std::size_t axis, double by);
  void set_lamp_gain(double gain);  ///< What the lamp gives, of what it should; drift comes on top.
  void set_temperatures(double lamp_c, double camera_c);
  void set_packet_weather(PacketWeather weather);

  // --- what sensors beside the picture see
  double lamp_temperature() const;    ///< [°C] 25 unless set
  double camera_temperature() const;  ///< [°C] 25 unless set
  PacketWeather packet_weather() const;

  /// Of the last 65,536 frames, in order.
  std::vector<ExposureRecord> records() const;
  /// Shadings of a whole image so far; a bracket at one lamp position needs one.
  std::int64_t renders() const;

 private:
  Result<void> may_move() const;
  bool homed_at(TimePoint time) const;
  void gantry_commanded();
  TimePoint seek_home();
  // With mutex_ held: what else has to hold at the same moment is looked at under the same lock.
  Result<TimePoint> start_move_locked(const GantryPosition& to, double speed_share = 1);
  void halt_locked();
  void forget_unfinished_homing(TimePoint now);
  LightPosition true_light(const GantryMotionState& motion) const;
  const Renderer& renderer_at(double turn);
  std::vector<std::uint64_t> position_words(const GantryPosition& drives) const;
  Result<SiteRadiance> radiance_at(const SceneMoment& moment, const std::stop_token& stop);

  const Rig rig_;
  Clock& clock_;
  const std::uint64_t seed_;
  const int threads_;
  const RenderOptions render_options_;
  const Mesh object_;  // as it lies before a turntable turns it
  const Reflectance truth_;

  mutable std::mutex mutex_;  // guards the state of gantry and lamp, and the counters
  GantryDynamics dynamics_;
  std::optional<TimePoint> homed_from_;
  std::map<std::size_t, TimePoint> seeking_;  ///< axes told to home by themselves, and until when
  std::string alarm_;
  std::set<std::string> open_interlocks_;
  double lamp_power_ = 0;
  TimePoint lamp_until_;
  const TimePoint opened_;
  double lamp_gain_ = 1;
  double lamp_temperature_ = 25, camera_temperature_ = 25;
  PacketWeather packet_weather_;
  std::uint64_t take_ = 0;
  std::uint64_t frames_ = 0;
  std::map<std::pair<double, double>, std::uint64_t>
      requests_;  // (power, exposure): how often since the last command
  std::deque<ExposureRecord> records_;

  std::vector<TimePoint> halts_;
  mutable std::mutex render_mutex_;                  // guards the last image shaded
  std::optional<std::pair<double, Renderer>> seen_;  // the object as turned so far
  struct Shaded {
    LightPosition light;
    double turn = 0;
    SiteRadiance radiance;
  };
  std::optional<Shaded> shaded_;
  std::int64_t renders_ = 0;
};

}  // namespace lightrig::sim
