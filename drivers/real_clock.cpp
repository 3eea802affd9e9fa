#include <condition_variable>
#include <mutex>

#include "drivers/clock.h"

namespace lightrig {

TimePoint RealClock::now() const {
  return std::chrono::time_point_cast<std::chrono::nanoseconds>(std::chrono::steady_clock::now());
}

void RealClock::sleep_until(TimePoint time, const std::stop_token& stop) {
  std::mutex mutex;
  std::condition_variable_any woken;
  std::unique_lock lock(mutex);
  woken.wait_until(lock, stop, time, [] { return false; });
}

}  // namespace lightrig
