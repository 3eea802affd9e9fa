#pragma once

#include <atomic>
#include <chrono>
#include <functional>
#include <utility>

namespace lightrig {

/// What the session thread promises: to be heard of again before a moment. The watchdog of systemd
/// is fed only while the promise holds, so a session thread that hangs is noticed although the
/// sockets still answer.
class Liveness {
 public:
  using SteadyClock = std::chrono::steady_clock;
  using Now = std::function<SteadyClock::time_point()>;

  explicit Liveness(Now now = &SteadyClock::now) : now_(std::move(now)) {}

  /// The session thread lives, or what it waits for got something done, and will say so again
  /// within this long. From any thread.
  void promise(std::chrono::milliseconds within);
  bool holds() const { return holds(now_()); }
  bool holds(SteadyClock::time_point at) const;

 private:
  Now now_;
  std::atomic<SteadyClock::rep> until_{SteadyClock::time_point::max().time_since_epoch().count()};
};

}  // namespace lightrig
