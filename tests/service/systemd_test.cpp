// The service as systemd sees it: its units, its notifications, its end.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <poll.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <csignal>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <regex>
#include <sstream>
#include <string>

#include "tests/paths.h"
#include "tests/service/scratch_folder.h"

namespace lightrig {
namespace {

namespace fs = std::filesystem;
using ::testing::HasSubstr;

std::string text_of(const fs::path& path) {
  std::ifstream in(path);
  std::stringstream text;
  text << in.rdbuf();
  return text.str();
}

struct Outcome {
  int code = -1;
  std::string text;
};

Outcome run(const std::string& command) {
  Outcome outcome;
  FILE* pipe = popen((command + " 2>&1").c_str(), "r");
  std::array<char, 4096> buffer{};
  for (std::size_t n = 0; (n = std::fread(buffer.data(), 1, buffer.size(), pipe)) > 0;)
    outcome.text.append(buffer.data(), n);
  const int status = pclose(pipe);
  outcome.code = WIFEXITED(status) ? WEXITSTATUS(status) : -1;
  return outcome;
}

/// The units with this build's program in them.
fs::path units_in(const fs::path& folder) {
  const fs::path source = fs::path(lightrig::test::source_dir) / "systemd";
  std::string unit = text_of(source / "lightrigd.service.in");
  unit = std::regex_replace(unit, std::regex("@CMAKE_INSTALL_FULL_BINDIR@"),
                            lightrig::test::build_dir);
  unit = std::regex_replace(unit, std::regex("@CMAKE_INSTALL_FULL_DOCDIR@"), "/usr/share/doc");
  std::ofstream(folder / "lightrigd.service") << unit;
  fs::copy(source / "lightrigd.socket", folder / "lightrigd.socket");
  return folder;
}

// Who lowers the one alone silently loses what the session lends the thread that it waits for.
TEST(Systemd, LetsAThreadThatWentDownComeUpAgainAsFarAsTheService) {
  const std::string unit =
      text_of(fs::path(lightrig::test::source_dir) / "systemd/lightrigd.service.in");
  std::smatch nice, limit;
  ASSERT_TRUE(std::regex_search(unit, nice, std::regex("\nNice=(.*)\n")));
  ASSERT_TRUE(std::regex_search(unit, limit, std::regex("\nLimitNICE=(.*)\n")));
  EXPECT_EQ(nice[1], limit[1]);
}

TEST(SystemdUnits, AreVerifiedWithoutAWord) {
  ScratchFolder folder;
  const std::string units = units_in(folder.path()).string();
  const Outcome verified =
      run("systemd-analyze verify " + units + "/lightrigd.service " + units + "/lightrigd.socket");
  EXPECT_EQ(verified.code, 0);
  // It returns 0 on unknown keys: any word is a fault.
  EXPECT_EQ(verified.text, "");
}

TEST(SystemdUnits, AreHardenedToAnExposureOfTwoAndAHalf) {
  ScratchFolder folder;
  const std::string units = units_in(folder.path()).string();
  const Outcome judged = run("systemd-analyze security --no-pager --offline=true --threshold=25 " +
                             units + "/lightrigd.service");
  EXPECT_EQ(judged.code, 0) << judged.text.substr(
      judged.text.size() > 200 ? judged.text.size() - 200 : 0);
}

// What docs/operations.md has people write, with this build's program in it.
TEST(SystemdUnits, ThePanelsDropInIsTheServiceWithAPort) {
  const std::string guide =
      text_of(fs::path(lightrig::test::source_dir) / "docs" / "operations.md");
  const auto begins = guide.find("    [Service]\n    ExecStart=\n");
  ASSERT_NE(begins, std::string::npos);
  std::string drop_in = guide.substr(begins, guide.find("\n\n", begins) - begins) + "\n";
  drop_in = std::regex_replace(drop_in, std::regex("\n {4}"), "\n").substr(4);
  drop_in = std::regex_replace(drop_in, std::regex("/usr/bin"), lightrig::test::build_dir);
  ScratchFolder folder;
  const fs::path units = units_in(folder.path());
  // It replaces the unit's command, and so must begin with all of it.
  const std::string unit = text_of(units / "lightrigd.service");
  const auto command = unit.find("ExecStart=");
  const std::string line = unit.substr(command, unit.find('\n', command) - command);
  EXPECT_THAT(drop_in, HasSubstr("ExecStart=\n" + line + " \\\n    --listen "));
  fs::create_directory(units / "lightrigd.service.d");
  std::ofstream(units / "lightrigd.service.d" / "override.conf") << drop_in;
  const Outcome verified = run("systemd-analyze verify " + units.string() + "/lightrigd.service " +
                               units.string() + "/lightrigd.socket");
  EXPECT_EQ(verified.code, 0);
  EXPECT_EQ(verified.text, "");
  const std::string help = run(std::string(lightrig::test::build_dir) + "/lightrigd --help").text;
  for (const char* option : {"--rig", "--session-root", "--listen", "--token-file"}) {
    EXPECT_THAT(drop_in, HasSubstr(option));
    EXPECT_THAT(help, HasSubstr(option));
  }
}

/// A socket that stands where systemd's would.
class NotifySocket {
 public:
  explicit NotifySocket(const fs::path& path) : fd_(socket(AF_UNIX, SOCK_DGRAM | SOCK_CLOEXEC, 0)) {
    sockaddr_un address{};
    address.sun_family = AF_UNIX;
    path.string().copy(address.sun_path, sizeof(address.sun_path) - 1);
    const void* raw = &address;
    good_ = bind(fd_, static_cast<const sockaddr*>(raw), sizeof address) == 0;
  }
  NotifySocket(const NotifySocket&) = delete;
  NotifySocket& operator=(const NotifySocket&) = delete;
  ~NotifySocket() { close(fd_); }
  bool good() const { return good_; }
  /// All that is said until `word` was.
  std::string hear(const std::string& word, int seconds) {
    std::string all;
    for (int i = 0; i < seconds * 10 && all.find(word) == std::string::npos; ++i) {
      pollfd ready{fd_, POLLIN, 0};
      if (poll(&ready, 1, 100) <= 0) continue;
      std::array<char, 4096> buffer{};
      const ssize_t n = recv(fd_, buffer.data(), buffer.size(), 0);
      if (n > 0) all.append(buffer.data(), static_cast<std::size_t>(n)).append("\n");
    }
    return all;
  }

 private:
  int fd_;
  bool good_ = false;
};

TEST(SystemdService, SaysReadyFeedsTheWatchdogAndEndsWithZeroOnSigterm) {
  ScratchFolder folder;
  NotifySocket notify(folder.path() / "notify");
  ASSERT_TRUE(notify.good());
  const std::string rig = std::string(lightrig::test::source_dir) + "/config/demo.toml";
  const std::string root = (folder.path() / "sessions").string();
  const std::string control = (folder.path() / "s.sock").string();
  const std::string program = std::string(lightrig::test::build_dir) + "/lightrigd";
  const pid_t child = fork();
  ASSERT_GE(child, 0);
  if (child == 0) {
    setenv("NOTIFY_SOCKET", (folder.path() / "notify").c_str(), 1);
    execl(program.c_str(), program.c_str(), "--rig", rig.c_str(), "--simulate", "--auto-arm",
          "--session-root", root.c_str(), "--socket", control.c_str(), "--log-level", "error",
          nullptr);
    _exit(127);
  }
  EXPECT_THAT(notify.hear("READY=1", 20), HasSubstr("READY=1"));
  EXPECT_THAT(notify.hear("WATCHDOG=1", 10), HasSubstr("WATCHDOG=1"));
  kill(child, SIGTERM);
  EXPECT_THAT(notify.hear("STOPPING=1", 10), HasSubstr("STOPPING=1"));
  int status = 0;
  ASSERT_EQ(waitpid(child, &status, 0), child);
  EXPECT_TRUE(WIFEXITED(status));
  EXPECT_EQ(WEXITSTATUS(status), 0);
  EXPECT_FALSE(fs::exists(control)) << "the socket is taken away at a clean end";
}

}  // namespace
}  // namespace lightrig
