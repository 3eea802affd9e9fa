#pragma once

#include <chrono>
#include <deque>
#include <memory>
#include <optional>
#include <string>
#include <string_view>

#include "sim/usb/grbl_machine.h"
#include "sim/wire_faults.h"

namespace lightrig::sim {

/// A GRBL controller with the faults of its wire, byte in, byte out, whatever carries the bytes. No
/// thread: whoever carries them calls tick() every few milliseconds.
class GrblFarEnd {
 public:
  /// `backend` and `firmware` as GrblMachine's.
  GrblFarEnd(const GrblGantry& backend, std::shared_ptr<World> world,
             std::shared_ptr<WireFaults> faults, GrblFirmware firmware = GrblFirmware::grbl)
      : machine_(backend, std::move(world), firmware),
        wire_(backend.letters.empty() ? Wire::lamp : Wire::gantry),
        faults_(std::move(faults)) {}

  /// Bytes that arrived together: one request to the faults' count.
  void receive(std::string_view bytes);
  /// Lets time pass. A fault that the carrier has to carry out itself comes back: unplug, stall,
  /// nak.
  std::optional<WireFault> tick();
  /// What is due to be sent, taken out; at most so many bytes.
  std::string take(std::size_t most = std::string::npos);
  bool has_something_to_say() const;

 private:
  struct Late {
    std::chrono::steady_clock::time_point time;
    std::string bytes;
  };
  void say(std::string bytes, std::chrono::milliseconds delay = {});
  void spoil(std::string said, const WireFault& fault);

  GrblMachine machine_;
  Wire wire_;
  std::shared_ptr<WireFaults> faults_;
  std::deque<Late> outbox_;
  std::chrono::steady_clock::time_point silent_until_{};
  bool booting_ = false;
};

}  // namespace lightrig::sim
