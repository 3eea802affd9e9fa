#pragma once

#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <functional>
#include <mutex>
#include <optional>
#include <stop_token>
#include <string>
#include <thread>
#include <utility>

#include "core/result.h"
#include "drivers/clock.h"

namespace lightrig {

/// A thread of the driver's own for a library whose calls block: the caller waits, but never longer
/// than its deadline or 10 ms after its stop request. A call given up runs on to its own end; until
/// then the lane answers `timed_out`, and its late result is thrown away, never handed to a later
/// caller. Destruction waits for the call in progress.
template <class T>
class BlockingLane {
 public:
  using Job = std::function<Result<T>(const std::stop_token&)>;

  explicit BlockingLane(std::string name)
      : name_(std::move(name)), thread_([this](const std::stop_token& stop) { work(stop); }) {}
  ~BlockingLane() {
    abandon_.request_stop();
    const std::lock_guard lock(mutex_);
    idle_abandon_.request_stop();
    thread_.request_stop();
  }
  BlockingLane(const BlockingLane&) = delete;
  BlockingLane& operator=(const BlockingLane&) = delete;

  /// Runs the job on the lane. The job's stop token ends with the caller's patience, so that a job
  /// made of several blocking calls can end between them. Errors: the job's own, `stopped`,
  /// `timed_out`.
  Result<T> run(Job job, Clock& clock, const Until& until) {
    using std::chrono::steady_clock;
    const auto real_deadline = steady_clock::now() + (until.deadline - clock.now());
    if (until.stop.stop_requested() || clock.now() >= until.deadline)
      return given_up(until, "had no time left before it began");
    std::unique_lock lock(mutex_);
    idle_abandon_.request_stop();
    if (!woken_.wait_until(lock, until.stop, real_deadline, [&] { return !busy_; }))
      return given_up(until,
                      "is still inside an earlier call that does not return within its deadline");
    abandon_ = std::stop_source();
    job_ = std::move(job);
    result_.reset();
    busy_ = true;
    const std::uint64_t ticket = ++ticket_;
    woken_.notify_all();
    woken_.wait_until(lock, until.stop, real_deadline,
                      [&] { return ticket_ == ticket && result_.has_value(); });
    if (!result_) {
      abandon_.request_stop();
      return given_up(until, "did not answer within its deadline");
    }
    Result<T> result = std::move(*result_);
    result_.reset();
    return result;
  }

  /// What the lane does by itself whenever nothing was asked of it for so long; its stop token ends
  /// once a caller waits. Set once, before the first call.
  void when_idle(std::chrono::milliseconds every, std::function<void(const std::stop_token&)> job) {
    const std::lock_guard lock(mutex_);
    idle_every_ = every;
    idle_ = std::move(job);
    woken_.notify_all();
  }

 private:
  tl::unexpected<Error> given_up(const Until& until, const char* what) const {
    if (until.stop.stop_requested())
      return fail(ErrorCode::stopped, name_ + ": stopped on request");
    return fail(ErrorCode::timed_out, name_ + " " + what);
  }

  void work(const std::stop_token& stop) {
    std::unique_lock lock(mutex_);
    while (!stop.stop_requested()) {
      const auto asked = [&] { return busy_; };
      const auto heard = [&] { return busy_ || idle_; };
      const bool job_came = idle_ ? woken_.wait_for(lock, stop, idle_every_, asked)
                                  : woken_.wait(lock, stop, heard) && busy_;
      if (stop.stop_requested() && !busy_) return;
      if (job_came) {
        run_job(lock);
      } else if (idle_) {
        run_idle(lock);
      }
    }
  }

  void run_job(std::unique_lock<std::mutex>& lock) {
    const Job job = std::move(job_);
    const std::stop_token abandon = abandon_.get_token();
    lock.unlock();
    Result<T> result = job(abandon);
    lock.lock();
    if (!abandon.stop_requested()) result_ = std::move(result);
    busy_ = false;
    woken_.notify_all();
  }

  void run_idle(std::unique_lock<std::mutex>& lock) {
    busy_ = true;
    idle_abandon_ = std::stop_source();
    const std::stop_token abandon = idle_abandon_.get_token();
    lock.unlock();
    idle_(abandon);
    lock.lock();
    busy_ = false;
    woken_.notify_all();
  }

  std::string name_;
  std::mutex mutex_;
  std::condition_variable_any woken_;
  bool busy_ = false;
  std::uint64_t ticket_ = 0;
  Job job_;
  std::optional<Result<T>> result_;
  std::stop_source abandon_, idle_abandon_;
  std::chrono::milliseconds idle_every_{0};
  std::function<void(const std::stop_token&)> idle_;
  std::jthread thread_;  // last: it uses all of the above
};

}  // namespace lightrig
