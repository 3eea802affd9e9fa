#include "sim/sim_clock.h"

#include <algorithm>
#include <cmath>
#include <condition_variable>
#include <mutex>
#include <set>

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

/// Simulated time runs `rate` times faster than real while someone sleeps on this clock, and as
/// real time does while all compute: waiting is hurried, work costs what it costs. It does not pass
/// the end of anyone's sleep before the sleeper has woken. At one fixed rate, the host's work and
/// its late wakings would count rate-fold, and a loaded host would lengthen the simulated session.
class ScaledClock final : public Clock {
 public:
  explicit ScaledClock(double rate) : rate_(rate), real_then_(real_.now()), then_(real_then_) {}

  TimePoint now() const override {
    const std::lock_guard lock(mutex_);
    return at(real_.now());
  }

  void sleep_until(TimePoint time, const std::stop_token& stop) override {
    const TimePoint begin = now();
    if (begin >= time) return;
    if (time - begin > never) return wait_for_stop(stop);
    std::multiset<TimePoint>::iterator end;
    change_sleepers([&] { end = ends_.insert(time); });
    // Rounded up, and looked at again: a sleeper never wakes before its time.
    while (!stop.stop_requested()) {
      const TimePoint current = now();
      if (current >= time) break;
      const double simulated = std::chrono::duration<double>(time - current).count();
      const auto wait = nanoseconds(std::llround(std::ceil(simulated / rate_ * 1e9)));
      real_.sleep_until(real_.now() + wait, stop);
    }
    change_sleepers([&] { ends_.erase(end); });
  }

 private:
  TimePoint at(TimePoint real) const {
    const double elapsed = std::chrono::duration<double>(real - real_then_).count();
    const double rate = ends_.empty() ? 1.0 : rate_;
    const TimePoint time = then_ + nanoseconds(std::llround(elapsed * rate * 1e9));
    return ends_.empty() ? time : std::max(then_, std::min(time, *ends_.begin()));
  }

  /// Time up to here was at the old rate.
  template <typename Change>
  void change_sleepers(Change change) {
    const std::lock_guard lock(mutex_);
    const TimePoint real = real_.now();
    then_ = at(real);
    real_then_ = real;
    change();
  }

  const double rate_;
  RealClock real_;
  mutable std::mutex mutex_;
  TimePoint real_then_, then_;     ///< the same moment on both clocks
  std::multiset<TimePoint> ends_;  ///< of the sleeps going on
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
