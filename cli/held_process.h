#pragma once

#include <chrono>
#include <csignal>
#include <string>

namespace lightrig::cli {

/// A process held (SIGSTOP) as one that hangs, for as long as this lives but no longer than
/// `at_most`, and let go on again whatever happens: the signals that would end this program wait,
/// and a child lets go on should it be killed.
class HeldProcess {
 public:
  HeldProcess(pid_t process, std::chrono::duration<double> at_most);
  ~HeldProcess();
  HeldProcess(const HeldProcess&) = delete;
  HeldProcess& operator=(const HeldProcess&) = delete;

  /// Why it could not be held; "" where it is.
  const std::string& why_not() const { return why_; }

 private:
  pid_t process_, guard_ = -1;
  int alive_ = -1;  ///< a pipe's end: that it is open tells the guard that this lives
  sigset_t before_{};
  std::string why_;
};

/// Why this program may not signal a process; "" where it may.
std::string why_not_held(pid_t process);

/// Whether a process of this machine is lightrigd: by now its number may be another's.
bool is_service(pid_t process);

}  // namespace lightrig::cli
