#pragma once

#include <chrono>
#include <csignal>
#include <string>

#include "config/file_descriptor.h"
#include "core/result.h"

namespace lightrig::cli {

/// The process that serves a control socket, by a handle (pidfd): its number may come to be
/// another's, the handle never. `claimed` is the number that the service gives itself; it is
/// believed where the kernel says that this process listens on the socket (SO_PEERCRED, or, where
/// systemd made the socket, that it holds it). Errors: refused: no process of this machine, not the
/// one that serves, or none that this program may signal; with what to do.
Result<FileDescriptor> serving_process(const std::string& socket, pid_t claimed);

/// A process held (SIGSTOP) as one that hangs, for as long as this lives but no longer than
/// `at_most`, and let go on again whatever happens: the signals that would end this program wait,
/// and a child lets go on should it be killed.
class HeldProcess {
 public:
  /// `process` is a pidfd and must outlive this.
  HeldProcess(const FileDescriptor& process, std::chrono::duration<double> at_most);
  ~HeldProcess();
  HeldProcess(const HeldProcess&) = delete;
  HeldProcess& operator=(const HeldProcess&) = delete;

  /// Why it could not be held; "" where it is.
  const std::string& why_not() const { return why_; }

 private:
  int process_;
  pid_t guard_ = -1;
  int alive_ = -1;  ///< a pipe's end: that it is open tells the guard that this lives
  sigset_t before_{};
  std::string why_;
};

}  // namespace lightrig::cli
