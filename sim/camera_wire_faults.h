#pragma once

#include <cstdint>
#include <mutex>
#include <optional>
#include <string_view>
#include <vector>

#include "core/result.h"

namespace lightrig::sim {

/// How a GigE Vision camera goes wrong at one of its frames.
enum class CameraFaultKind : std::uint8_t {
  packet_lost,        ///< a payload packet never arrives; asked for again, it does
  packet_gone,        ///< a payload packet never arrives, and the camera cannot send it again
  leader_gone,        ///< the same of the leader
  trailer_lost,       ///< the trailer never arrives; asked for again, it does
  packets_reordered,  ///< every pair of payload packets arrives the wrong way round
  packets_doubled,    ///< every payload packet arrives twice
  frozen,             ///< it says nothing any more, on either channel, for `seconds`
  rebooted,           ///< it forgets everything and is deaf for `seconds`
  privilege_stolen,   ///< another program takes control of it and keeps it for `seconds`
  wrong_exposure,     ///< it exposes twice as long as its register says
  stale_frame,        ///< it sends the frame before once more, under a new number
  wrong_size,         ///< it sends half the rows
};

/// Lower-case name, as a fault script has it; and back.
std::string_view name_of(CameraFaultKind kind);
std::optional<CameraFaultKind> camera_fault_kind(std::string_view name);

/// The n-th frame that the camera takes, counted from 1 since it was hosted, goes wrong this way.
struct CameraFault {
  CameraFaultKind kind = CameraFaultKind::packet_lost;
  std::uint64_t nth_frame = 1;
  double seconds = 2;  ///< of real time, where it lasts
};

/// What goes wrong with a simulated camera: scripted, added while it runs, and lost at random. Safe
/// from several threads; the camera consults it.
class CameraWireFaults {
 public:
  explicit CameraWireFaults(std::vector<CameraFault> faults = {}) : faults_(std::move(faults)) {}

  void add(const CameraFault& fault);
  /// Strikes at the next frame.
  void add_next(CameraFaultKind kind, double seconds = 2);
  /// This share of all stream packets, those sent again too, is lost from now on, chosen by the
  /// seed. Without `resend` the camera sends nothing again.
  void lose(double share, bool resend, std::uint64_t seed = 1);

  /// From now on frames are numbered anew from every start of an acquisition, as some models do.
  void number_anew_from_every_start();
  bool numbers_anew() const;

  /// From now on gamma once switched on stays on, and every write to it is answered well.
  void hold_gamma();
  bool holds_gamma() const;

  /// From now on loading a user set is answered well and changes nothing, as in a model without.
  void keep_settings();
  bool keeps_settings() const;

  /// The camera begins a frame: what strikes it.
  std::vector<CameraFault> begin_frame();
  /// Whether the packet now being sent is lost on its way.
  bool loses_packet();
  bool resends() const;

  std::uint64_t frames() const;
  std::vector<CameraFault> struck() const;
  std::uint64_t packets_lost() const;

 private:
  mutable std::mutex mutex_;
  std::vector<CameraFault> faults_;
  std::vector<CameraFault> struck_;
  std::uint64_t frames_ = 0, packets_ = 0, packets_lost_ = 0;
  double share_ = 0;
  bool resend_ = true, numbers_anew_ = false, holds_gamma_ = false, keeps_settings_ = false;
  std::uint64_t seed_ = 1;
};

}  // namespace lightrig::sim
