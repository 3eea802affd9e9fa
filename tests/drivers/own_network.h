#pragma once

#include <net/if.h>
#include <sched.h>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <unistd.h>

#include <cerrno>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <string>

namespace lightrig::test {

/// LIGHTRIG_DEMAND_ALL=1 is said by scripts/test: nothing that the machine ought to give is to be
/// done without. A test that could only skip then ends its process as failed.
inline bool all_is_demanded() {
  const char* demand = std::getenv("LIGHTRIG_DEMAND_ALL");
  return demand != nullptr && *demand != '\0';
}

namespace detail {
inline std::string try_own_network() {
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
}  // namespace detail

/// Puts this process in a network of its own with nothing but loopback, so that a test never meets
/// a camera or a service of the host. Needs root, or unprivileged user namespaces. Returns "" or
/// the reason why not. Call before any thread.
inline std::string enter_own_network() {
  std::string obstacle = detail::try_own_network();
  if (obstacle.empty() || !all_is_demanded()) return obstacle;
  std::fprintf(
      stderr,
      "%s: no test of a wire can run. Run as root, or allow unprivileged user namespaces "
      "(`sysctl -w kernel.unprivileged_userns_clone=1`); LIGHTRIG_DEMAND_ALL= does without "
      "these tests\n",
      obstacle.c_str());
  std::exit(1);
}

}  // namespace lightrig::test
