#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "drivers/devices.h"

namespace lightrig::sim {

/// A call that can go wrong.
enum class DeviceCall : std::uint8_t {
  any,  ///< counts every call below together
  gantry_home,
  gantry_move,
  gantry_status,
  gantry_clear_fault,
  lamp_set,
  lamp_state,
  camera_expose,
};

/// How it goes wrong.
enum class FaultEffect : std::uint8_t {
  timed_out,     ///< nothing is done, no answer comes: the deadline passes
  answer_lost,   ///< the call is carried out, but its answer is lost: the deadline passes
  disconnected,  ///< gone, and gone for every later call until the device is opened again
  refused,       ///< the device says no
  // A success that is none:
  ignored,         ///< nothing is done, and success is reported (a move, the lamp)
  short_move,      ///< the gantry stops a tenth of the way early and calls it arrived
  wrong_exposure,  ///< the frame was taken at twice the exposure, and says so
  stale_frame,     ///< the previous frame once more, with its old id (a first frame: timed_out)
  wrong_size,      ///< half the rows are missing
};

std::string_view name_of(DeviceCall call);
std::string_view name_of(FaultEffect effect);

/// The n-th call of a kind, counted from 1, goes wrong this way.
struct Fault {
  DeviceCall call = DeviceCall::any;
  std::uint64_t nth = 1;
  FaultEffect effect = FaultEffect::timed_out;
};

/// Which calls go wrong, and what has been called so far. The count goes on over reopened devices.
class FaultScript {
 public:
  explicit FaultScript(std::vector<Fault> faults) : faults_(std::move(faults)) {}

  /// Counts a call and says what happens to it; empty when it goes well. An effect that the call
  /// cannot have (a stale frame from the lamp) counts as refused.
  std::optional<FaultEffect> next(DeviceCall call);

  std::uint64_t calls(DeviceCall call) const;
  /// Faults that have struck so far.
  std::vector<Fault> struck() const;

 private:
  mutable std::mutex mutex_;
  std::vector<Fault> faults_;
  std::map<DeviceCall, std::uint64_t> calls_;
  std::vector<Fault> struck_;
};

/// The same devices, with the script's faults. The clock is the one the devices wait on.
Devices with_faults(Devices devices, std::shared_ptr<FaultScript> script, Clock& clock);

}  // namespace lightrig::sim
