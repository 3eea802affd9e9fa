#include "daemon/service/log.h"

#include <fmt/chrono.h>
#include <fmt/format.h>
#include <spdlog/logger.h>
#include <spdlog/sinks/base_sink.h>
#include <spdlog/sinks/null_sink.h>
#include <sys/stat.h>
#include <sys/uio.h>
#include <systemd/sd-journal.h>
#include <unistd.h>

#include <cctype>
#include <cerrno>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <mutex>
#include <vector>

#include "daemon/service/log_writer.h"

namespace lightrig {
namespace {

constexpr std::size_t lines_kept = 2000;

spdlog::level::level_enum to_spdlog(LogLevel level) {
  switch (level) {
    case LogLevel::debug:
      return spdlog::level::debug;
    case LogLevel::info:
      return spdlog::level::info;
    case LogLevel::warning:
      return spdlog::level::warn;
    case LogLevel::error:
      return spdlog::level::err;
  }
  return spdlog::level::info;
}

// syslog's numbers, as journald's PRIORITY field takes them [RFC 5424, table 2].
int to_priority(LogLevel level) {
  switch (level) {
    case LogLevel::debug:
      return 7;
    case LogLevel::info:
      return 6;
    case LogLevel::warning:
      return 4;
    case LogLevel::error:
      return 3;
  }
  return 6;
}

bool is_plain(std::string_view value) {
  constexpr std::string_view allowed = "._-:/+,%@";
  for (char c : value)
    if (std::isalnum(static_cast<unsigned char>(c)) == 0 && allowed.find(c) == allowed.npos)
      return false;
  return !value.empty();
}

std::string quoted(std::string_view value) {
  if (is_plain(value)) return std::string(value);
  std::string text = "\"";
  for (char c : value) {
    const auto byte = static_cast<unsigned char>(c);
    if (c == '"' || c == '\\')
      (text += '\\') += c;
    else if (c == '\n')
      text += "\\n";
    else if (byte < 0x20 || byte == 0x7f)
      text += fmt::format("\\x{:02x}", byte);
    else
      text += c;
  }
  return text + '"';
}

std::string journal_key(std::string_view key) {
  std::string name = "LIGHTRIG_";
  for (char c : key) {
    const auto byte = static_cast<unsigned char>(c);
    name += std::isalnum(byte) != 0 ? static_cast<char>(std::toupper(byte)) : '_';
  }
  return name;
}

LogEntry journal_entry(LogLevel level, std::string_view event, std::initializer_list<Field> fields,
                       const std::string& line) {
  LogEntry texts{"MESSAGE=" + line, fmt::format("PRIORITY={}", to_priority(level)),
                 fmt::format("LIGHTRIG_EVENT={}", event)};
  for (const Field& field : fields) texts.push_back(journal_key(field.key) + "=" + field.value);
  return texts;
}

// A log that cannot be written must not stop a session: there is nowhere left to say so.

void send_to_journald(const LogEntry& texts) {
  std::vector<iovec> parts;
  parts.reserve(texts.size());
  for (const std::string& text : texts)
    parts.push_back({const_cast<char*>(text.data()), text.size()});  // read only, says sd-journal
  (void)sd_journal_sendv(parts.data(), static_cast<int>(parts.size()));
}

void print(const LogEntry& lines) {
  for (const std::string& line : lines) {
    // Not by stdio: at the end of the process its lock would still be held by a write that hangs.
    std::string_view left = line;
    while (!left.empty()) {
      const ssize_t written = ::write(STDERR_FILENO, left.data(), left.size());
      if (written < 0 && errno == EINTR) continue;
      if (written <= 0) return;
      left.remove_prefix(static_cast<std::size_t>(written));
    }
  }
}

/// Lines as a console shows them, the level in colour on a terminal, handed to the writer.
class ConsoleSink : public spdlog::sinks::base_sink<std::mutex> {
 public:
  explicit ConsoleSink(LogWriter& writer)
      : writer_(writer),
        coloured_(::isatty(STDERR_FILENO) == 1 && std::getenv("NO_COLOR") == nullptr) {}

 private:
  void sink_it_(const spdlog::details::log_msg& message) override {
    spdlog::memory_buf_t text;
    formatter_->format(message, text);
    std::string line(text.data(), text.size());
    if (coloured_ && message.color_range_end > message.color_range_start) {
      const char* colour = message.level >= spdlog::level::err    ? "\033[31m"
                           : message.level == spdlog::level::warn ? "\033[33m"
                           : message.level == spdlog::level::info ? "\033[32m"
                                                                  : "\033[36m";
      line.insert(message.color_range_end, "\033[m");
      line.insert(message.color_range_start, colour);
    }
    writer_.add({std::move(line)});
  }
  void flush_() override {}

  LogWriter& writer_;
  bool coloured_;
};

}  // namespace

std::optional<LogLevel> log_level_of(std::string_view name) {
  for (LogLevel level : {LogLevel::debug, LogLevel::info, LogLevel::warning, LogLevel::error})
    if (name == name_of(level)) return level;
  return {};
}

std::string_view name_of(LogLevel level) {
  switch (level) {
    case LogLevel::debug:
      return "debug";
    case LogLevel::info:
      return "info";
    case LogLevel::warning:
      return "warning";
    case LogLevel::error:
      return "error";
  }
  return "unknown";
}

std::string log_line(std::string_view event, std::initializer_list<Field> fields) {
  std::string line = fmt::format("event={}", quoted(event));
  for (const Field& field : fields)
    if (!field.value.empty()) line += fmt::format(" {}={}", field.key, quoted(field.value));
  return line;
}

Log::Sink Log::default_sink() {
  // systemd names device and inode of the stream it connected; a redirected stderr differs.
  const char* stream = std::getenv("JOURNAL_STREAM");
  struct stat facts {};
  if (stream == nullptr || fstat(STDERR_FILENO, &facts) != 0) return Sink::console;
  return fmt::format("{}:{}", facts.st_dev, facts.st_ino) == stream ? Sink::journald
                                                                    : Sink::console;
}

Log::Log(LogLevel level, Sink sink) : sink_(sink) {
  const auto lost = [sink](std::size_t entries) {
    const std::string count = std::to_string(entries);
    const std::string line = log_line("log_lines_lost", {{"count", count}});
    if (sink == Sink::journald)
      return journal_entry(LogLevel::warning, "log_lines_lost", {{"count", count}}, line);
    return LogEntry{line + "\n"};
  };
  if (sink != Sink::none)
    writer_ = std::make_unique<LogWriter>(sink == Sink::journald ? send_to_journald : print, lost);
  spdlog::sink_ptr target;
  if (sink == Sink::console)
    target = std::make_shared<ConsoleSink>(*writer_);
  else
    target = std::make_shared<spdlog::sinks::null_sink_mt>();
  logger_ = std::make_unique<spdlog::logger>("lightrigd", std::move(target));
  logger_->set_pattern("%Y-%m-%dT%H:%M:%S.%e%z %^%-7l%$ %v");
  set_level(level);
}

Log::~Log() = default;

void Log::write(LogLevel level, std::string_view event, std::initializer_list<Field> fields) const {
  if (!logger_->should_log(to_spdlog(level))) return;
  const std::string line = log_line(event, fields);
  {
    const std::time_t now = std::chrono::system_clock::to_time_t(std::chrono::system_clock::now());
    const std::lock_guard lock(mutex_);
    recent_.push_back(
        fmt::format("{:%Y-%m-%dT%H:%M:%SZ} {:<7} {}\n", fmt::gmtime(now), name_of(level), line));
    if (recent_.size() > lines_kept) recent_.pop_front();
  }
  if (sink_ == Sink::journald)
    writer_->add(journal_entry(level, event, fields, line));
  else
    logger_->log(to_spdlog(level), spdlog::string_view_t(line));
}

std::string Log::recent() const {
  const std::lock_guard lock(mutex_);
  return fmt::format("{}", fmt::join(recent_, ""));
}

void Log::set_level(LogLevel level) { logger_->set_level(to_spdlog(level)); }

LogLevel Log::level() const {
  for (LogLevel level : {LogLevel::debug, LogLevel::info, LogLevel::warning})
    if (logger_->level() == to_spdlog(level)) return level;
  return LogLevel::error;
}

}  // namespace lightrig
