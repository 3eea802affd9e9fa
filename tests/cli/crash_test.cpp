// A service that dies in the middle of a session, as the person sees it who waits for the session.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <chrono>
#include <csignal>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <string>
#include <thread>

#include "tests/paths.h"
#include "tests/service/scratch_folder.h"
#include "tests/service/small_rig.h"

namespace lightrig {
namespace {

using namespace std::chrono_literals;
using ::testing::HasSubstr;
using ::testing::Not;

class Crash : public ::testing::Test {
 protected:
  void SetUp() override { (void)small_rig(folder_.path()); }
  void TearDown() override { kill_service(); }

  void begin_service() {
    const std::string program = std::string(lightrig::test::build_dir) + "/lightrigd";
    const std::string rig = (folder_.path() / "rig.toml").string();
    service_ = fork();
    ASSERT_GE(service_, 0);
    if (service_ == 0) {
      if (std::freopen((folder_.path() / "log").c_str(), "a", stderr) == nullptr) _exit(126);
      execl(program.c_str(), "lightrigd", "--rig", rig.c_str(), "--simulate", "--auto-arm",
            "--clock-rate", "5", "--socket", socket_.c_str(), "--session-root",
            (folder_.path() / "sessions").c_str(), nullptr);
      _exit(127);
    }
    for (int i = 0; i < 3000 && lightrig("status").find("state      armed") == std::string::npos;
         ++i)
      std::this_thread::sleep_for(20ms);
  }
  void kill_service() {
    if (service_ <= 0) return;
    kill(service_, SIGKILL);
    waitpid(service_, nullptr, 0);
    service_ = 0;
  }
  FILE* begin(const std::string& verb) const {
    return popen((std::string(lightrig::test::build_dir) + "/lightrig " + verb + " --socket " +
                  socket_ + " 2>&1 </dev/null")
                     .c_str(),
                 "r");
  }
  /// What a verb says, on both outputs.
  std::string lightrig(const std::string& verb) const {
    FILE* pipe = begin(verb);
    std::string text;
    std::array<char, 4096> line{};
    while (std::fgets(line.data(), line.size(), pipe) != nullptr) text += line.data();
    pclose(pipe);
    return text;
  }

  ScratchFolder folder_;
  const std::string socket_ = (folder_.path() / "s").string();
  pid_t service_ = 0;
};

TEST_F(Crash, IsTakenForWhatItIsAndLeavesASessionThatCanBeResumed) {
  begin_service();
  FILE* waiting = begin("start --wait");
  std::string text;
  std::array<char, 4096> line{};
  while (std::fgets(line.data(), line.size(), waiting) != nullptr) {
    text += line.data();
    if (text.find(" 1/") != std::string::npos) kill_service();  // one light is done
  }
  EXPECT_NE(pclose(waiting), 0);
  const auto id = text.substr(8, text.find('\n') - 8);  // "session ID"
  EXPECT_THAT(text, HasSubstr("the service ended during session " + id));
  EXPECT_THAT(text, HasSubstr("lightrig resume " + id));
  EXPECT_THAT(text, Not(HasSubstr("no lightrigd answers")));

  begin_service();
  EXPECT_THAT(lightrig("status"), HasSubstr("unfinished " + id + ": interrupted after "));
  EXPECT_THAT(lightrig("sessions"), HasSubstr("lights; lightrig resume " + id));
}

}  // namespace
}  // namespace lightrig
