#pragma once

#include <condition_variable>
#include <cstddef>
#include <deque>
#include <functional>
#include <mutex>
#include <thread>

namespace lightrig {

/// A thread for what may take a while and must not hold up a socket: reading folders, encoding the
/// preview. Jobs run in order; the queue has a limit.
class Worker {
 public:
  explicit Worker(std::size_t limit);
  ~Worker();  ///< runs what is queued, then joins
  Worker(const Worker&) = delete;
  Worker& operator=(const Worker&) = delete;

  /// False when the queue is full or the worker is stopping: the job will not run.
  bool post(std::function<void()> job);

  /// Runs what is queued and takes no more.
  void stop();

 private:
  void run();

  const std::size_t limit_;
  std::mutex mutex_;
  std::condition_variable changed_;
  std::deque<std::function<void()>> jobs_;
  bool stopping_ = false;
  std::thread thread_;
};

}  // namespace lightrig
