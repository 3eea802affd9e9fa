#pragma once

#include <deque>
#include <initializer_list>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <string_view>

namespace spdlog {
class logger;
}

namespace lightrig {

class LogWriter;

enum class LogLevel : unsigned char { debug, info, warning, error };

/// The level of a name ("debug", "info", "warning", "error"); empty for any other.
std::optional<LogLevel> log_level_of(std::string_view name);
std::string_view name_of(LogLevel level);

/// One fact of a log line.
struct Field {
  std::string_view key;
  std::string value;
};

/// The line as it is written: "event=armed by=\"uid 1000\"": a value is quoted when it holds
/// anything but letters, digits and ._-:/+,%@; control characters become escapes, so that one event
/// is one line. A field without a value is left out.
std::string log_line(std::string_view event, std::initializer_list<Field> fields);

/// The service's log: one line per event. On a console with time and level; under systemd to
/// journald, each field besides as LIGHTRIG_<KEY>. Safe to call from any thread, and never waits
/// for who reads the log [LogWriter]; the level may change at run time.
class Log {
 public:
  enum class Sink : unsigned char { console, journald, none };

  /// journald where standard error is connected to it (JOURNAL_STREAM), else console.
  static Sink default_sink();

  Log(LogLevel level, Sink sink);
  ~Log();

  void write(LogLevel level, std::string_view event, std::initializer_list<Field> fields) const;
  void debug(std::string_view event, std::initializer_list<Field> fields = {}) const {
    write(LogLevel::debug, event, fields);
  }
  void info(std::string_view event, std::initializer_list<Field> fields = {}) const {
    write(LogLevel::info, event, fields);
  }
  void warning(std::string_view event, std::initializer_list<Field> fields = {}) const {
    write(LogLevel::warning, event, fields);
  }
  void error(std::string_view event, std::initializer_list<Field> fields = {}) const {
    write(LogLevel::error, event, fields);
  }

  /// The last lines written, oldest first, each with time and level: for a post-mortem without a
  /// journal.
  std::string recent() const;

  void set_level(LogLevel level);
  LogLevel level() const;

 private:
  Sink sink_;
  std::unique_ptr<LogWriter> writer_;
  std::unique_ptr<spdlog::logger> logger_;
  mutable std::mutex mutex_;
  mutable std::deque<std::string> recent_;  ///< written by write(), which is const for its callers
};

}  // namespace lightrig
