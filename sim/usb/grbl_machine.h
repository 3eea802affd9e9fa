#pragma once

#include <deque>
#include <map>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "config/rig.h"
#include "sim/world.h"

namespace lightrig::sim {

/// A GRBL 1.1 controller that moves the world, byte in, byte out, as the firmware was seen to
/// behave: `ok` means queued, real-time bytes are never acknowledged, a hard or soft limit is
/// followed by silence, a reset in motion loses the position. Held by `!` or by the door, it obeys
/// no line until `~` or a reset; the door also makes spindle and coolant stop [Grbl 1.1h,
/// protocol.c]. No wire, no thread; tick() lets time pass.
class GrblMachine {
 public:
  /// A backend without axes is a controller that has the lamp alone, homing off; one with axes has
  /// the lamp where the rig says that it hangs on the gantry's controller.
  GrblMachine(const GrblGantry& backend, std::shared_ptr<World> world);

  /// Takes bytes as they come; returns what the controller says at once.
  std::string receive(std::string_view bytes);
  /// What it says by itself now: the ok of a homing that ended, the next queued move.
  std::string tick();
  /// Power fails and comes back: what it says when it is up again.
  std::string power_cycle();

 private:
  std::string realtime(char byte);
  std::string line(std::string text);
  std::string block(const std::string& text);
  std::string heed_lines();
  void look_at_door();
  void switch_lamp();
  void darken();
  GantryStatus axes() const;
  bool suspended() const { return hold_ || door_; }
  std::string alarm(int number);
  std::string reset();
  std::string report() const;
  std::string settings() const;
  std::string start_homing();
  void start_next();
  double machine_units(std::size_t axis, double value) const;

  const GrblGantry backend_;
  std::shared_ptr<World> world_;
  const bool moves_;  ///< it has axes
  const bool lit_;    ///< it has the lamp
  std::string pending_;
  std::deque<GantryPosition> queue_;
  GantryPosition going_to_;
  std::deque<std::string> unheeded_;  ///< lines that came while it was held
  bool homing_ = false, hold_ = false, resumable_ = false;
  bool door_ = false;  ///< it was open; closed, it waits for `~`
  bool alarm_;
  bool silent_ = false;  ///< after a hard or soft limit, until a reset
  bool lamp_on_ = false, dims_ = false, lamp_refused_ = false;
  double spindle_ = 0;  ///< S word
  std::map<int, double> settings_;
};

}  // namespace lightrig::sim
