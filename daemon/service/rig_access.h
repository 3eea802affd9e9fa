#pragma once

#include <chrono>
#include <memory>
#include <optional>
#include <stop_token>
#include <string>
#include <thread>
#include <vector>

#include "config/rig.h"
#include "core/result.h"
#include "daemon/session/lay_candidates.h"
#include "daemon/session/session.h"
#include "drivers/devices.h"

namespace lightrig {

namespace sim {
class World;
}

/// What the devices said when last asked.
struct RigFacts {
  GantryStatus gantry;
  std::optional<LampState> lamp;
  std::string camera;  ///< identity
};

/// The devices of the service's rig, real or in memory, opened and closed as one. For the session
/// thread alone: nobody else touches a device.
class RigAccess {
 public:
  /// `simulate` opens the rig in memory, with a clock `clock_rate` times faster than real.
  RigAccess(const Rig& rig, bool simulate, double clock_rate);
  ~RigAccess();

  /// Opens all devices, makes the lamp dark, waits for an arm that still brakes, and asks everyone
  /// how they are. A simulated rig gets this object in front of its camera; open with another
  /// object, it is opened anew. Errors: those of the devices, with what to do; refused where the
  /// gantry does not come to rest.
  Result<RigFacts> open(const ObjectConfig& object, const std::stop_token& stop);

  /// Lamp dark, motion stopped, devices given back. True if the lamp is known to be dark.
  bool close();
  /// What a session knows of a lamp whose wire it has lost: close() can only say as much.
  void remember_lamp(bool dark) { lamp_left_dark_ = dark; }
  bool is_open() const { return devices_.has_value(); }

  Result<RigFacts> facts(const std::stop_token& stop);
  /// The same once the gantry rests, or at once where it has an alarm or an open interlock. Errors:
  /// refused where it does not come to rest.
  Result<RigFacts> facts_at_rest(const std::stop_token& stop);
  Result<void> home(const std::stop_token& stop);
  Result<void> clear_fault(const std::stop_token& stop);
  /// What a session has put before the camera, for whoever moves the gantry after it.
  void set_object(const ObjectConfig& object);

  /// Moves straight to axis values where nothing forbids it (guarded_move): the object in the way
  /// is that of open() or set_object(). Errors: refused with the reason; those of the gantry.
  Result<void> move_to(const GantryPosition& target, const std::stop_token& stop);

  /// Sets the lamp [0, 1] and reads it back. Its lease runs: it goes dark by itself after
  /// max_on_time. Errors: refused beyond the rig's max_power, or with an interlock open; those of
  /// the lamp.
  Result<LampState> set_lamp(double power, const std::stop_token& stop);
  /// Whether a lamp that set_lamp() lit has its lease for as long as this, or is dark: while the
  /// gantry moves or the camera exposes nobody heeds it.
  bool lease_covers(std::chrono::nanoseconds time) const;
  /// Makes the lamp dark once its lease is over: an output at the end of a wire knows of none. To
  /// be called every few seconds while nothing else is done.
  Result<void> heed_lease();
  /// One frame where the gantry stands, the lamp as it is. Errors: those of the camera.
  Result<Frame> expose(double seconds, const std::stop_token& stop);

  /// Devices opened anew, for a session whose wire broke. Opening real devices may block for
  /// seconds: a stop returns at once with `stopped`, and what comes of it is closed again before
  /// anything else is opened.
  Result<Devices> reopen(Reopen what, std::unique_ptr<Camera> old, const std::stop_token& stop);

  /// A simulated rig makes new noise when a shot is taken anew.
  void set_take(std::uint64_t take);

  /// Loads what jogs keep clear of beside the rig's own volumes: the object, once. Errors: refused,
  /// where its mesh cannot be read.
  Result<void> know_obstacles();
  Devices& devices() { return *devices_; }
  Clock& clock() { return *clock_; }
  bool simulated() const { return simulate_; }

 private:
  Result<void> all_open() const;  ///< error disconnected where a device is missing
  Result<Devices> open_now(Reopen what);
  Until within(std::chrono::nanoseconds time, const std::stop_token& stop) const;

  const Rig& rig_;
  const bool simulate_;
  std::unique_ptr<Clock> clock_;
  std::shared_ptr<sim::World> world_;  ///< of a simulated rig; its devices share it
  std::optional<Devices> devices_;
  ObjectConfig object_;
  std::optional<Obstacles> obstacles_;  ///< with that object; empty until asked for
  bool lamp_left_dark_ = false;
  std::optional<TimePoint> lamp_until_;  ///< while set_lamp() has it lit
  std::jthread opening_;  ///< last: it uses the clock; the one before it is its own to wait for
};

}  // namespace lightrig
