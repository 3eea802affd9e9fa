#include "cli/held_process.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <poll.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <fstream>

namespace lightrig::cli {

HeldProcess::HeldProcess(pid_t process, std::chrono::duration<double> at_most) : process_(process) {
  sigset_t ending;
  sigemptyset(&ending);
  for (const int one : {SIGINT, SIGTERM, SIGHUP, SIGQUIT, SIGTSTP}) sigaddset(&ending, one);
  pthread_sigmask(SIG_BLOCK, &ending, &before_);
  int ends[2] = {-1, -1};
  if (pipe2(ends, O_CLOEXEC) == 0) guard_ = fork();
  if (guard_ == 0) {
    close(ends[1]);
    pollfd gone{ends[0], 0, 0};  // hung up: the other end has closed
    (void)poll(&gone, 1, static_cast<int>(1000 * at_most.count()));
    kill(process_, SIGCONT);
    _exit(0);
  }
  const int error = errno;
  if (ends[0] >= 0) close(ends[0]);
  alive_ = ends[1];
  if (guard_ < 0)
    why_ = std::strerror(error);
  else if (kill(process_, SIGSTOP) != 0)
    why_ = std::strerror(errno);
}

HeldProcess::~HeldProcess() {
  if (why_.empty()) kill(process_, SIGCONT);
  if (alive_ >= 0) close(alive_);
  if (guard_ > 0) waitpid(guard_, nullptr, 0);
  pthread_sigmask(SIG_SETMASK, &before_, nullptr);
}

std::string why_not_held(pid_t process) {
  return kill(process, 0) == 0 ? "" : std::strerror(errno);
}

bool is_service(pid_t process) {
  std::ifstream in(fmt::format("/proc/{}/comm", process));
  std::string name;
  return std::getline(in, name) && name == "lightrigd";
}

}  // namespace lightrig::cli
