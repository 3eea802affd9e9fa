#include "daemon/service/log_writer.h"

#include <chrono>
#include <condition_variable>
#include <deque>
#include <mutex>
#include <utility>

namespace lightrig {
namespace {

constexpr std::chrono::seconds patience_at_the_end{1};

}  // namespace

struct LogWriter::State {
  std::function<void(const LogEntry&)> write;
  std::function<LogEntry(std::size_t)> lost;
  std::mutex mutex;
  std::condition_variable changed;
  std::deque<LogEntry> waiting;
  std::size_t dropped = 0;
  bool writing = false, ended = false;

  void run() {
    std::unique_lock lock(mutex);
    while (true) {
      changed.wait(lock, [this] { return ended || !waiting.empty(); });
      if (waiting.empty()) return;
      const std::size_t missing = std::exchange(dropped, 0);
      const LogEntry next = std::move(waiting.front());
      waiting.pop_front();
      writing = true;
      lock.unlock();
      if (missing > 0) write(lost(missing));
      write(next);
      lock.lock();
      writing = false;
      changed.notify_all();
    }
  }
};

LogWriter::LogWriter(std::function<void(const LogEntry&)> write,
                     std::function<LogEntry(std::size_t)> lost)
    : state_(std::make_shared<State>()) {
  state_->write = std::move(write);
  state_->lost = std::move(lost);
  thread_ = std::thread([state = state_] { state->run(); });
}

LogWriter::~LogWriter() {
  std::unique_lock lock(state_->mutex);
  state_->ended = true;
  state_->changed.notify_all();
  const bool done = state_->changed.wait_for(
      lock, patience_at_the_end, [this] { return state_->waiting.empty() && !state_->writing; });
  lock.unlock();
  done ? thread_.join() : thread_.detach();
}

void LogWriter::add(LogEntry entry) {
  {
    const std::lock_guard lock(state_->mutex);
    if (state_->waiting.size() >= most) {
      state_->waiting.pop_front();
      ++state_->dropped;
    }
    state_->waiting.push_back(std::move(entry));
  }
  state_->changed.notify_all();
}

}  // namespace lightrig
