#include "cli/held_process.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <poll.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <sstream>

// Debian 12's header forgets to say that its functions are C's.
extern "C" {
#include <sys/pidfd.h>
}

namespace lightrig::cli {
namespace {

namespace fs = std::filesystem;

/// Whoever began to listen on the socket, as the kernel noted it; 0 where nobody answers, or it is
/// no process that can be seen from here.
pid_t listener_of(const std::string& path) {
  const FileDescriptor probe(socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0));
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  if (path.size() >= sizeof address.sun_path) return 0;
  path.copy(address.sun_path, path.size());
  const void* raw = &address;
  ucred who{};
  socklen_t size = sizeof who;
  if (connect(probe.get(), static_cast<const sockaddr*>(raw), sizeof address) != 0 ||
      getsockopt(probe.get(), SOL_SOCKET, SO_PEERCRED, &who, &size) != 0)
    return 0;
  return who.pid;
}

/// The kernel's number of the socket that listens at a path; "" where there is none.
std::string socket_number(const std::string& path) {
  constexpr unsigned long accepts = 0x10000;  // __SO_ACCEPTCON
  std::ifstream table("/proc/net/unix");
  std::string line;
  std::getline(table, line);  // its heading
  while (std::getline(table, line)) {
    std::istringstream fields(line);
    std::string at, references, protocol, type, state, number, name;
    unsigned long flags = 0;
    fields >> at >> references >> protocol >> std::hex >> flags >> type >> state >> number >> name;
    if ((flags & accepts) != 0 && name == path) return number;
  }
  return {};
}

/// Whether a process holds that socket: systemd made it, and handed it over.
bool holds(pid_t process, const std::string& number) {
  if (number.empty()) return false;
  std::error_code error;
  for (fs::directory_iterator entry(fmt::format("/proc/{}/fd", process), error), end;
       !error && entry != end; entry.increment(error)) {
    std::error_code gone;
    if (fs::read_symlink(entry->path(), gone) == fmt::format("socket:[{}]", number)) return true;
  }
  return false;
}

}  // namespace

Result<FileDescriptor> serving_process(const std::string& socket, pid_t claimed) {
  const auto refuse = [&](const std::string& why) {
    return fail(ErrorCode::refused,
                fmt::format("the service (process {}) cannot be held: {}", claimed, why));
  };
  FileDescriptor process(claimed > 1 ? pidfd_open(claimed, 0) : -1);
  if (!process.valid()) return refuse("it is no process of this machine");
  // The handle first: should the number become another's on the way, the handle is of a dead one.
  std::error_code error;
  const fs::path real = fs::canonical(socket, error);
  if (listener_of(socket) != claimed &&
      !holds(claimed, socket_number(error ? socket : real.string())))
    return refuse("it is not seen to be the one that serves " + socket +
                  "; run lightrig commission as root, on the machine and outside any container");
  if (pidfd_send_signal(process.get(), 0, nullptr, 0) != 0)
    return refuse(fmt::format("{}; run lightrig commission as root", std::strerror(errno)));
  return process;
}

HeldProcess::HeldProcess(const FileDescriptor& process, std::chrono::duration<double> at_most)
    : process_(process.get()) {
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
    pidfd_send_signal(process_, SIGCONT, nullptr, 0);
    _exit(0);
  }
  const int error = errno;
  if (ends[0] >= 0) close(ends[0]);
  alive_ = ends[1];
  if (guard_ < 0)
    why_ = std::strerror(error);
  else if (pidfd_send_signal(process_, SIGSTOP, nullptr, 0) != 0)
    why_ = std::strerror(errno);
}

HeldProcess::~HeldProcess() {
  if (why_.empty()) pidfd_send_signal(process_, SIGCONT, nullptr, 0);
  if (alive_ >= 0) close(alive_);
  if (guard_ > 0) waitpid(guard_, nullptr, 0);
  pthread_sigmask(SIG_SETMASK, &before_, nullptr);
}

}  // namespace lightrig::cli
