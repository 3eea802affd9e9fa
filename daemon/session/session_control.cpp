#include "daemon/session/session.h"

namespace lightrig {

void SessionControl::pause(std::string reason) {
  const std::lock_guard lock(mutex_);
  pause_ = true;
  resumed_ = false;
  reason_ = std::move(reason);
}

void SessionControl::resume() {
  {
    const std::lock_guard lock(mutex_);
    pause_ = false;
    resumed_ = true;
  }
  word_.notify_all();
}

void SessionControl::stop_after_shot() {
  const std::lock_guard lock(mutex_);
  stop_after_shot_ = true;
}

void SessionControl::abort(std::string reason) {
  {
    const std::lock_guard lock(mutex_);
    // The first word counts: an abort that follows a halt must not lose why it began. One that says
    // the same and more is the first one's explanation.
    if (!stop_.stop_requested() || reason.starts_with(reason_)) reason_ = std::move(reason);
    halted_ = false;
  }
  stop_.request_stop();
}

void SessionControl::halt(std::string reason) {
  {
    const std::lock_guard lock(mutex_);
    if (stop_.stop_requested()) return;
    reason_ = std::move(reason);
    halted_ = true;
  }
  stop_.request_stop();
}

bool SessionControl::pause_requested() const {
  const std::lock_guard lock(mutex_);
  return pause_;
}

bool SessionControl::stop_after_shot_requested() const {
  const std::lock_guard lock(mutex_);
  return stop_after_shot_;
}

bool SessionControl::halted() const {
  const std::lock_guard lock(mutex_);
  return halted_;
}

std::string SessionControl::reason() const {
  const std::lock_guard lock(mutex_);
  return reason_;
}

void SessionControl::forget_word() {
  const std::lock_guard lock(mutex_);
  resumed_ = false;
}

bool SessionControl::wait_for_word(std::chrono::milliseconds at_most) {
  std::unique_lock lock(mutex_);
  word_.wait_for(lock, stop_.get_token(), at_most, [this] { return resumed_; });
  const bool came = resumed_ || stop_.stop_requested();
  resumed_ = false;
  return came;
}

std::string_view name_of(SessionOutcome outcome) {
  switch (outcome) {
    case SessionOutcome::done:
      return "done";
    case SessionOutcome::stopped_early:
      return "stopped_early";
    case SessionOutcome::paused:
      return "paused";
    case SessionOutcome::aborted:
      return "aborted";
    case SessionOutcome::faulted:
      return "faulted";
  }
  return "unknown";
}

}  // namespace lightrig
