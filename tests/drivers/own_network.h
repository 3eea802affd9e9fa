#pragma once

#include <net/if.h>
#include <sched.h>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <unistd.h>

#include <cstring>
#include <fstream>
#include <string>

namespace lightrig::test {

/// Puts this process in a network of its own with nothing but loopback, so that a test never meets
/// a camera or a service of the host. Needs root, or unprivileged user namespaces. Returns "" or
/// the reason why not. Call before any thread.
inline std::string enter_own_network() {
  const uid_t uid = getuid();
  if (unshare(CLONE_NEWNET) != 0) {
    if (unshare(CLONE_NEWUSER | CLONE_NEWNET) != 0)
      return std::string("no network namespace to be had: ") + std::strerror(errno);
    std::ofstream("/proc/self/setgroups") << "deny";
    std::ofstream("/proc/self/uid_map") << "0 " << uid << " 1";
  }
  const int control = socket(AF_INET, SOCK_DGRAM, 0);
  ifreq request{};
  std::strncpy(request.ifr_name, "lo", IFNAMSIZ - 1);
  request.ifr_flags = IFF_UP | IFF_RUNNING;
  const bool up = ioctl(control, SIOCSIFFLAGS, &request) == 0;
  close(control);
  return up ? "" : std::string("cannot bring loopback up: ") + std::strerror(errno);
}

}  // namespace lightrig::test
