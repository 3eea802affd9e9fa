// Which process serves a socket, and holding it.
#include "cli/held_process.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <csignal>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <functional>
#include <string>
#include <thread>

namespace lightrig::cli {
namespace {

using namespace std::chrono_literals;
using ::testing::HasSubstr;

/// A child of this program that does this and then sleeps; killed at the end.
class Child {
 public:
  explicit Child(const std::function<void()>& first = [] {}) {
    int ends[2];
    EXPECT_EQ(pipe(ends), 0);
    pid_ = fork();
    if (pid_ == 0) {
      first();
      (void)!write(ends[1], "x", 1);
      while (true) pause();
    }
    char ready = 0;
    EXPECT_EQ(read(ends[0], &ready, 1), 1);
    close(ends[0]);
    close(ends[1]);
  }
  ~Child() {
    kill(pid_, SIGKILL);
    waitpid(pid_, nullptr, 0);
  }
  Child(const Child&) = delete;
  Child& operator=(const Child&) = delete;

  pid_t pid() const { return pid_; }
  /// 'S' while it sleeps, 'T' while it is held.
  char state() const {
    std::ifstream in("/proc/" + std::to_string(pid_) + "/stat");
    std::string text{std::istreambuf_iterator<char>(in), {}};
    const auto name_ends = text.rfind(") ");
    return name_ends == std::string::npos ? '?' : text[name_ends + 2];
  }
  bool comes_to(char state_wanted) const {
    const auto end = std::chrono::steady_clock::now() + 20s;
    while (state() != state_wanted && std::chrono::steady_clock::now() < end)
      std::this_thread::sleep_for(5ms);
    return state() == state_wanted;
  }

 private:
  pid_t pid_ = -1;
};

class ServingProcess : public testing::Test {
 protected:
  ServingProcess() {
    std::string name = testing::TempDir() + "lightrig_held_XXXXXX";
    folder_ = mkdtemp(name.data());
    socket_ = folder_ + "/control.sock";
  }
  ~ServingProcess() override { std::filesystem::remove_all(folder_); }

  int listening() const {
    const int fd = ::socket(AF_UNIX, SOCK_STREAM, 0);
    sockaddr_un address{};
    address.sun_family = AF_UNIX;
    socket_.copy(address.sun_path, sizeof address.sun_path - 1);
    const void* raw = &address;
    EXPECT_EQ(bind(fd, static_cast<const sockaddr*>(raw), sizeof address), 0);
    EXPECT_EQ(listen(fd, 4), 0);
    return fd;
  }

  std::string folder_, socket_;
};

TEST_F(ServingProcess, IsTheOneThatListensWhateverAnotherIsCalled) {
  const Child service([&] { listening(); });
  const Child other;
  ASSERT_TRUE(serving_process(socket_, service.pid()));
  // Found: any process by the name of lightrigd was believed; these two have the same.
  const auto refused = serving_process(socket_, other.pid());
  ASSERT_FALSE(refused);
  EXPECT_THAT(refused.error().message, HasSubstr("not seen to be the one that serves"));
  EXPECT_FALSE(serving_process(socket_, 0));
  EXPECT_FALSE(serving_process(folder_ + "/nobody.sock", service.pid()));
}

// As systemd does it: it listens, and hands the socket over.
TEST_F(ServingProcess, IsTheOneThatTheSocketWasHandedTo) {
  const int fd = listening();
  const Child service;
  close(fd);
  const Child other;
  EXPECT_TRUE(serving_process(socket_, service.pid()));
  EXPECT_FALSE(serving_process(socket_, other.pid()));
}

TEST_F(ServingProcess, IsHeldAsLongAsItsHolderLivesOrIsAllowedTo) {
  const Child service([&] { listening(); });
  const auto process = serving_process(socket_, service.pid());
  ASSERT_TRUE(process) << process.error().message;
  {
    const HeldProcess held(*process, 60s);
    EXPECT_EQ(held.why_not(), "");
    EXPECT_TRUE(service.comes_to('T'));
  }
  EXPECT_TRUE(service.comes_to('S'));
  const HeldProcess held(*process, 1s);
  EXPECT_TRUE(service.comes_to('S')) << "no longer than it was said";
}

}  // namespace
}  // namespace lightrig::cli
