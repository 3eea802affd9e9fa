// kill -9 at every step by which a session reaches the disk: before and after every fsync and every
// rename. The test program stands in for both, so that the product needs no hook for it.
#include <dlfcn.h>
#include <fmt/format.h>
#include <gtest/gtest.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <atomic>
#include <csignal>
#include <cstdlib>
#include <fstream>

#include "daemon/session/durable_file.h"
#include "tests/session/scene.h"
#include "tests/session/scratch.h"

namespace {

std::atomic<long> kill_at{0};  // 0: never
std::atomic<long> points{0};

void kill_point() {
  if (++points == kill_at) ::raise(SIGKILL);
}

}  // namespace

extern "C" int fsync(int fd) {
  using Function = int (*)(int);
  static const auto real = reinterpret_cast<Function>(::dlsym(RTLD_NEXT, "fsync"));
  kill_point();
  const int result = real(fd);
  kill_point();
  return result;
}

extern "C" int rename(const char* from, const char* to) noexcept {
  using Function = int (*)(const char*, const char*);
  static const auto real = reinterpret_cast<Function>(::dlsym(RTLD_NEXT, "rename"));
  kill_point();
  const int result = real(from, to);
  kill_point();
  return result;
}

namespace lightrig {
namespace {

namespace fs = std::filesystem;

// The process that is killed: captures into the folder that the environment names.
TEST(KilledProcess, DISABLED_CapturesUntilItIsKilled) {
  const char* folder = std::getenv("LIGHTRIG_KILL_FOLDER");
  const char* at = std::getenv("LIGHTRIG_KILL_AT");
  if (folder == nullptr || at == nullptr) GTEST_SKIP() << "run by KillMatrix alone";
  const Scratch scratch;
  Laboratory laboratory(small_rig(scratch.path()));
  small_plan();
  SessionControl control;
  points = 0;
  kill_at = std::atol(at);
  const SessionEnd end = capture_in({folder}, laboratory, control);
  kill_at = 0;
  ASSERT_EQ(end.outcome, SessionOutcome::done) << end.reason;
  std::ofstream(std::string(folder) + ".points") << points;
}

/// Runs the process above; its wait status.
int run_and_kill(const fs::path& folder, long at) {
  const std::string program = fs::read_symlink("/proc/self/exe").string();
  const std::string where = "LIGHTRIG_KILL_FOLDER=" + folder.string();
  const std::string when = fmt::format("LIGHTRIG_KILL_AT={}", at);
  std::vector<std::string> arguments{program, "--gtest_also_run_disabled_tests",
                                     "--gtest_filter=KilledProcess.*", "--gtest_brief=1"};
  std::vector<std::string> variables{where, when, "PATH=/usr/bin:/bin"};
  std::vector<char*> argv, envp;
  for (std::string& text : arguments) argv.push_back(text.data());
  for (std::string& text : variables) envp.push_back(text.data());
  argv.push_back(nullptr);
  envp.push_back(nullptr);
  pid_t child = 0;
  EXPECT_EQ(::posix_spawn(&child, program.c_str(), nullptr, nullptr, argv.data(), envp.data()), 0);
  int status = 0;
  EXPECT_EQ(::waitpid(child, &status, 0), child);
  return status;
}

/// Frames that the journal vouches for and that are not there as it says.
int lost_frames(const SessionFolder& folder) {
  const Replay replay = replay_journal(folder.journal()).value();
  const Captured captured = captured_of(replay.events).value();
  std::vector<StoredFrame> frames = captured.darks;
  for (const CapturedShot& shot : captured.shots) {
    frames.insert(frames.end(), shot.frames.begin(), shot.frames.end());
  }
  int lost = 0;
  for (const StoredFrame& frame : frames) {
    const auto bytes = read_file(folder.root / frame.file);
    if (!bytes || sha256_hex(*bytes) != frame.sha256) ++lost;
  }
  return lost;
}

TEST(KillMatrix, KilledAtAnyStepASessionResumesToTheSameBytesAndLosesNoFrame) {
  const Scratch scratch;
  const Rig rig = small_rig(scratch.path());
  const auto create = [&](const std::string& id) {
    return create_session(rig, spec_of(rig), small_plan(), id).value();
  };
  const SessionFolder whole = create("whole");
  ASSERT_EQ(run_and_kill(whole.root, 0), 0);
  long count = 0;
  std::ifstream(whole.root.string() + ".points") >> count;
  ASSERT_GE(count, 200);  // distinct steps at which a kill can strike
  const std::string expected = comparable_text(whole);
  // All of them when asked (some minutes); else a few, spread over the session.
  const long stride = std::getenv("LIGHTRIG_THOROUGH") != nullptr ? 1 : count / 12;
  int identical = 0, tried = 0, twice = 0;
  for (long at = 1; at <= count; at += stride) {
    const SessionFolder folder = create(fmt::format("k{}", at));
    const int status = run_and_kill(folder.root, at);
    ASSERT_TRUE(WIFSIGNALED(status) && WTERMSIG(status) == SIGKILL) << "point " << at;
    EXPECT_EQ(lost_frames(folder), 0) << "point " << at;
    // Some are struck once more, while they are resumed: a dozen steps or so into it.
    if (tried % 4 == 0 && at < count / 2) {
      const int again = run_and_kill(folder.root, 1 + at * 7 % 17);
      ASSERT_TRUE(WIFSIGNALED(again) && WTERMSIG(again) == SIGKILL) << "again, point " << at;
      EXPECT_EQ(lost_frames(folder), 0) << "again, point " << at;
      ++twice;
    }
    Laboratory laboratory(rig);
    SessionControl control;
    const SessionEnd end = capture_in(folder, laboratory, control);
    EXPECT_EQ(end.outcome, SessionOutcome::done) << "point " << at << ": " << end.reason;
    const bool same = comparable_text(folder) == expected;
    EXPECT_TRUE(same) << "point " << at;
    identical += same ? 1 : 0;
    ++tried;
    fs::remove_all(folder.root);
  }
  EXPECT_GE(twice, 2);
  fmt::print("kill points={} of {} twice={} identical={}\n", tried, count, twice, identical);
}

}  // namespace
}  // namespace lightrig
