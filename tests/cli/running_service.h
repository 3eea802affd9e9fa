#pragma once

#include <gtest/gtest.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <chrono>
#include <csignal>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <sstream>
#include <string>
#include <thread>

#include "tests/paths.h"
#include "tests/service/scratch_folder.h"
#include "tests/service/small_rig.h"

namespace lightrig {

/// What a verb says, on both outputs, and how it ends.
struct Said {
  std::string text;
  int code = -1;
};

/// The service as a process of its own, asked by `lightrig` as a person asks it.
class RunningService : public ::testing::Test {
 protected:
  void SetUp() override { (void)small_rig(folder_.path()); }
  void TearDown() override { kill_service(); }

  void begin_service(const std::string& clock_rate) {
    const std::string program = std::string(lightrig::test::build_dir) + "/lightrigd";
    const std::string rig = (folder_.path() / "rig.toml").string();
    service_ = fork();
    ASSERT_GE(service_, 0);
    if (service_ == 0) {
      if (std::freopen((folder_.path() / "log").c_str(), "a", stderr) == nullptr) _exit(126);
      execl(program.c_str(), "lightrigd", "--rig", rig.c_str(), "--simulate", "--auto-arm",
            "--clock-rate", clock_rate.c_str(), "--socket", socket_.c_str(), "--session-root",
            (folder_.path() / "sessions").c_str(), nullptr);
      _exit(127);
    }
    for (int i = 0; i < 3000 && lightrig("status").find("state      armed") == std::string::npos;
         ++i)
      std::this_thread::sleep_for(std::chrono::milliseconds(20));
  }
  void kill_service() {
    if (service_ <= 0) return;
    kill(service_, SIGKILL);
    waitpid(service_, nullptr, 0);
    service_ = 0;
  }
  FILE* begin(const std::string& verb) const {
    return popen(("LIGHTRIG_SOCKET=" + socket_ + " " + lightrig::test::build_dir + "/lightrig " +
                  verb + " 2>&1 </dev/null")
                     .c_str(),
                 "r");
  }
  Said ask(const std::string& verb) const {
    FILE* pipe = begin(verb);
    Said said;
    std::array<char, 4096> line{};
    while (std::fgets(line.data(), line.size(), pipe) != nullptr) said.text += line.data();
    const int status = pclose(pipe);
    said.code = WIFEXITED(status) ? WEXITSTATUS(status) : -WTERMSIG(status);
    return said;
  }
  std::string lightrig(const std::string& verb) const { return ask(verb).text; }
  /// The id of a session that is captured to its end, result and all.
  std::string whole_session() const {
    const std::string text = lightrig("start --wait");
    EXPECT_NE(text.find("result in "), std::string::npos) << text;
    return text.substr(8, text.find('\n') - 8);  // "session ID"
  }
  std::string folder_of(const std::string& session) const {
    return (folder_.path() / "sessions" / session).string();
  }
  /// What the service has logged.
  std::string log() const {
    std::stringstream text;
    text << std::ifstream(folder_.path() / "log").rdbuf();
    return text.str();
  }

  ScratchFolder folder_;
  const std::string socket_ = (folder_.path() / "s").string();
  pid_t service_ = 0;
};

}  // namespace lightrig
