#include "daemon/service/log.h"

#include <fcntl.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <algorithm>
#include <condition_variable>
#include <csignal>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

#include "daemon/service/log_writer.h"

namespace lightrig {
namespace {

/// Somebody who reads a log only once told to; outlives a writer that gave up on him.
struct SlowReader {
  std::mutex mutex;
  std::condition_variable changed;
  bool open = false;
  std::vector<std::string> read;

  void take(const LogEntry& entry) {
    std::unique_lock lock(mutex);
    changed.wait(lock, [this] { return open; });
    read.push_back(entry.front());
    changed.notify_all();
  }
  void begin() {
    const std::lock_guard lock(mutex);
    open = true;
    changed.notify_all();
  }
};

LogEntry lost(std::size_t count) { return {std::to_string(count) + " lost"}; }

TEST(LogWriter, NeverWaitsForItsReaderAndSaysWhatIsLost) {
  const auto reader = std::make_shared<SlowReader>();
  const std::size_t all = LogWriter::most + 50;
  {
    LogWriter writer([reader](const LogEntry& entry) { reader->take(entry); }, lost);
    for (std::size_t i = 0; i < all; ++i) writer.add({std::to_string(i)});
    reader->begin();
  }
  // Perhaps the first was in hand when the rest came.
  const std::size_t missing = all - (reader->read.size() - 1);
  EXPECT_GE(missing, 49U);
  EXPECT_LE(missing, 50U);
  const auto said = std::ranges::find(reader->read, std::to_string(missing) + " lost");
  EXPECT_LE(said - reader->read.begin(), 1);
  EXPECT_EQ(reader->read.back(), std::to_string(all - 1));
}

TEST(LogWriter, EndsBesideAWriteThatHangs) {
  const auto reader = std::make_shared<SlowReader>();
  {
    LogWriter writer([reader](const LogEntry& entry) { reader->take(entry); }, lost);
    writer.add({"held"});
  }
  reader->begin();
  std::unique_lock lock(reader->mutex);
  reader->changed.wait(lock, [&] { return !reader->read.empty(); });
  EXPECT_EQ(reader->read, std::vector<std::string>{"held"});
}

// A terminal held by Ctrl-S, or `lightrigd | less`: the write that fills the pipe never returns.
TEST(Log, APipeThatNobodyReadsHoldsNobodyUp) {
  std::signal(SIGPIPE, SIG_IGN);  // as in lightrigd
  int ends[2];
  ASSERT_EQ(::pipe(ends), 0);
  ASSERT_GT(::fcntl(ends[1], F_SETPIPE_SZ, 4096), 0);
  const int stderr_before = ::dup(STDERR_FILENO);
  ::dup2(ends[1], STDERR_FILENO);
  auto log = std::make_unique<Log>(LogLevel::info, Log::Sink::console);
  for (int i = 0; i < 1000; ++i) log->info("knock", {{"n", std::to_string(i)}});
  EXPECT_NE(log->recent().find("n=999"), std::string::npos);
  log.reset();
  ::dup2(stderr_before, STDERR_FILENO);
  ::close(
      ends[1]);  // the write that hangs holds no descriptor of its own: it ends with the reader's
  char first[256];
  const ssize_t size = ::read(ends[0], first, sizeof first);
  ::close(ends[0]);
  ASSERT_GT(size, 0);
  EXPECT_NE(std::string(first, static_cast<std::size_t>(size)).find("info    event=knock n=0\n"),
            std::string::npos);
  ::close(stderr_before);
}

TEST(LogLine, StaysOneLineWhateverAValueHolds) {
  EXPECT_EQ(log_line("armed", {{"by", "uid 7"}, {"n", "3"}}), "event=armed by=\"uid 7\" n=3");
  EXPECT_EQ(log_line("x", {{"text", "a\nevent=forged\x1b[31m\"\\"}}),
            R"(event=x text="a\nevent=forged\x1b[31m\"\\")");
  EXPECT_EQ(log_line("x", {{"empty", ""}}), "event=x");
}

}  // namespace
}  // namespace lightrig
