#pragma once

#include <atomic>
#include <chrono>

namespace lightrig {

/// What the session thread promises: to be heard of again before a moment. The watchdog of systemd
/// is fed only while the promise holds, so a session thread that hangs is noticed although the
/// sockets still answer.
class Liveness {
 public:
  using SteadyClock = std::chrono::steady_clock;

  /// The session thread lives, and will say so again within this long.
  void promise(std::chrono::milliseconds within);
  bool holds(SteadyClock::time_point now = SteadyClock::now()) const;

 private:
  std::atomic<SteadyClock::rep> until_{SteadyClock::time_point::max().time_since_epoch().count()};
};

}  // namespace lightrig
