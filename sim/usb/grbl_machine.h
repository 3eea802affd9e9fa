#pragma once

#include <cstdint>
#include <deque>
#include <map>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "config/rig.h"
#include "sim/world.h"

namespace lightrig::sim {

enum class GrblFirmware : std::uint8_t {
  grbl,  ///< GRBL 1.1
  hal,   ///< grblHAL: an error is answered to every line until an empty one; CRLF is one line
};

/// A GRBL controller that moves the world, byte in, byte out, as the firmware was seen to
/// behave: `ok` means queued, real-time bytes are never acknowledged, a hard or soft limit is
/// followed by silence, a reset in motion loses the position. Held by `!` or by the door, it obeys
/// no line until `~` or a reset; the door also makes spindle and coolant stop [Grbl 1.1h,
/// protocol.c]. Somebody has left it a work offset, in which it counts whatever is not said in
/// machine coordinates (G53), and $10 says in which it reports. No wire, no thread; tick() lets
/// time pass.
class GrblMachine {
 public:
  /// A backend without axes is a controller that has the lamp alone, homing off; one with axes has
  /// the lamp where the rig says that it hangs on the gantry's controller.
  GrblMachine(const GrblGantry& backend, std::shared_ptr<World> world,
              GrblFirmware firmware = GrblFirmware::grbl);

  /// Takes bytes as they come; returns what the controller says at once.
  std::string receive(std::string_view bytes);
  /// What it says by itself now: the ok of a homing that ended, the next queued move.
  std::string tick();
  /// Power fails and comes back: what it says when it is up again.
  std::string power_cycle();

 private:
  std::string realtime(char byte);
  std::string line(std::string text);
  std::string obey(const std::string& text);
  std::string set(const std::string& text);
  std::string block(const std::string& text);
  std::string heed_lines();
  void look_at_door();
  void switch_lamp();
  void darken();
  GantryStatus axes() const;
  bool suspended() const { return hold_ || door_; }
  std::string alarm(int number);
  std::string reset();
  std::string report();
  std::string settings() const;
  std::string start_homing();
  void start_next();
  double machine_units(std::size_t axis, double value) const;
  double speed_share(const GantryPosition& to, double feed) const;

  const GrblGantry backend_;
  std::shared_ptr<World> world_;
  const bool moves_;  ///< it has axes
  const bool lit_;    ///< it has the lamp
  const GrblFirmware firmware_;
  std::string pending_;
  struct Move {
    GantryPosition to;
    double feed = 0;  ///< [unit/min] 0: rapid
  };
  std::deque<Move> queue_;
  Move going_;
  /// What a reset sets back [Grbl 1.1h, gc_init].
  struct Modal {
    bool rapid = true, absolute = true, inches = false;
    double feed = 0;  ///< [unit/min]
  };
  Modal modal_;
  int sticky_error_ = 0;       ///< grblHAL: until an empty line
  int reports_to_offset_ = 0;  ///< status reports until the next one with WCO
  bool after_cr_ = false;
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
