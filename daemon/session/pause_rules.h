#pragma once

#include <cstddef>
#include <cstdint>
#include <deque>

#include "config/rig.h"
#include "drivers/devices.h"

namespace lightrig {

/// Whether a condition holds a session up.
enum class Hold : std::uint8_t { none, held };

/// The state of a condition after a reading: held above the upper bound, released at or below the
/// lower one, unchanged between them. A reading that is not a number holds.
Hold next(Hold state, const PauseRule& rule, double reading);

/// Whether a paused session goes on: by itself only where the rule says so and it is released; on a
/// person's word as soon as the reading is no longer above the upper bound.
bool may_go_on(const PauseRule& rule, double reading, bool word);

/// Packets that a camera lost or sent again, frame by frame, over the last so many frames.
class PacketWindow {
 public:
  explicit PacketWindow(int over_frames) : size_(static_cast<std::size_t>(over_frames)) {}

  /// Counters as they stand before the frames that count. A camera opened anew begins at zero.
  void begin(const CameraCounters& now) { last_ = now; }
  /// Counters after one more attempt at a frame, come or not.
  void add(const CameraCounters& now);
  /// Only what comes from here on counts.
  void forget() { bad_.clear(); }

  bool full() const { return bad_.size() == size_; }
  double per_frame() const;  ///< [packets/frame] 0 when there is none

 private:
  std::size_t size_;
  CameraCounters last_;
  std::deque<double> bad_;
};

}  // namespace lightrig
