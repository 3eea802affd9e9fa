#include "sim/sim_clock.h"

#include <cmath>
#include <condition_variable>
#include <mutex>

#include "core/check.h"

namespace lightrig::sim {
namespace {

using std::chrono::nanoseconds;

/// A time this far off is a wait for the stop request alone: "no deadline" must not throw the clock
/// to the end of time.
constexpr nanoseconds never = std::chrono::hours(24 * 365);

void wait_for_stop(const std::stop_token& stop) {
  std::mutex mutex;
  std::condition_variable_any woken;
  std::unique_lock lock(mutex);
  woken.wait(lock, stop, [] { return false; });
}

/// Simulated time runs at a fixed rate of real time.
class ScaledClock final : public Clock {
 public:
  explicit ScaledClock(double rate) : rate_(rate), start_(real_.now()) {}

  TimePoint now() const override {
    const double elapsed = std::chrono::duration<double>(real_.now() - start_).count();
    return start_ + nanoseconds(std::llround(elapsed * rate_ * 1e9));
  }

  void sleep_until(TimePoint time, const std::stop_token& stop) override {
    if (time - start_ > never * 100) return wait_for_stop(stop);
    // Rounded up, and looked at again: a sleeper never wakes before its time.
    while (!stop.stop_requested()) {
      const TimePoint current = now();
      if (current >= time) return;
      const double simulated = std::chrono::duration<double>(time - current).count();
      const auto wait = nanoseconds(std::llround(std::ceil(simulated / rate_ * 1e9)));
      real_.sleep_until(real_.now() + wait, stop);
    }
  }

 private:
  double rate_;
  RealClock real_;
  TimePoint start_;
};

/// Time stands still but for sleeping, which jumps: a week passes in no time.
class JumpingClock final : public Clock {
 public:
  JumpingClock() : now_(RealClock().now()) {}

  TimePoint now() const override {
    const std::lock_guard lock(mutex_);
    return now_;
  }

  void sleep_until(TimePoint time, const std::stop_token& stop) override {
    if (stop.stop_requested()) return;
    if (time - now() > never) return wait_for_stop(stop);
    const std::lock_guard lock(mutex_);
    if (time > now_) now_ = time;
  }

 private:
  mutable std::mutex mutex_;
  TimePoint now_;
};

}  // namespace

std::unique_ptr<Clock> make_clock(double rate) {
  CHECK(rate > 0);
  if (std::isinf(rate)) return std::make_unique<JumpingClock>();
  return std::make_unique<ScaledClock>(rate);
}

}  // namespace lightrig::sim
