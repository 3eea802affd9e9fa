#pragma once

#include <chrono>
#include <stop_token>

namespace lightrig {

using TimePoint = std::chrono::time_point<std::chrono::steady_clock, std::chrono::nanoseconds>;

/// Time as the rig lives it: real, or simulated and faster than real. Handed to all that waits.
class Clock {
 public:
  virtual ~Clock() = default;
  virtual TimePoint now() const = 0;
  /// Returns at the time, or within 10 ms of a stop request.
  virtual void sleep_until(TimePoint time, const std::stop_token& stop) = 0;
};

/// The machine's monotonic clock.
class RealClock final : public Clock {
 public:
  TimePoint now() const override;
  void sleep_until(TimePoint time, const std::stop_token& stop) override;
};

/// How long a device call may take, and what may end it earlier.
struct Until {
  TimePoint deadline;
  std::stop_token stop;
};

}  // namespace lightrig
