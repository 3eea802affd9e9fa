#pragma once

#include <cstddef>
#include <functional>
#include <memory>
#include <string>
#include <thread>
#include <vector>

namespace lightrig {

/// What one event is to a sink: a line for a console, the fields for journald.
using LogEntry = std::vector<std::string>;

/// Writes log entries on a thread of its own, in the order of add(): a terminal held by Ctrl-S, a
/// pipe that nobody reads or a journald that hangs must not hold up an ABORT. Where the writing
/// falls `most` entries behind, the oldest are lost, and an entry says how many.
class LogWriter {
 public:
  static constexpr std::size_t most = 10000;

  /// `write` may block; `lost` makes the entry that so many are missing. Both are called on the
  /// thread.
  LogWriter(std::function<void(const LogEntry&)> write, std::function<LogEntry(std::size_t)> lost);
  /// Waits a second at most for what is still to be written; a write that hangs is left to itself.
  ~LogWriter();
  LogWriter(const LogWriter&) = delete;
  LogWriter& operator=(const LogWriter&) = delete;

  /// Never blocks on a write.
  void add(LogEntry entry);

 private:
  struct State;
  std::shared_ptr<State> state_;  ///< the thread's too: it may outlive this
  std::thread thread_;
};

}  // namespace lightrig
