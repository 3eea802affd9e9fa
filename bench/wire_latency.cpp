// How long a motion command takes from the call to its bytes on the wire, and what polling a move
// costs. The real Modbus TCP driver in one process, the simulated controller in another, a loopback
// of their own; when bytes were on the wire is the kernel's own time stamp of the packet, seen by a
// raw socket. A move_to() first asks where the drives are and what forbids motion (two drives and a
// door: three round trips), then writes: stated are the first byte, the motion write itself, and
// what of that is the driver's own, without the controller's time for its answers.
//   wire_latency [--count N]
#include <arpa/inet.h>
#include <fmt/format.h>
#include <linux/if_ether.h>
#include <linux/if_packet.h>
#include <signal.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <ctime>
#include <mutex>
#include <thread>
#include <vector>

#include "config/read_rig.h"
#include "drivers/backends.h"
#include "sim/hosted_rig.h"
#include "tests/drivers/own_network.h"
#include "tests/paths.h"

namespace lightrig {
namespace {

using namespace std::chrono_literals;

constexpr std::uint16_t port = 1502;
constexpr std::uint8_t write_registers = 0x10;
constexpr double degree = 0.017453292519943295;

double now_us() {
  timespec time{};
  clock_gettime(CLOCK_REALTIME, &time);
  return 1e6 * static_cast<double>(time.tv_sec % 100000) + static_cast<double>(time.tv_nsec) / 1e3;
}

[[noreturn]] void die(const std::string& why) {
  std::fprintf(stderr, "wire_latency: %s\n", why.c_str());
  std::_Exit(2);
}

Rig rig_of_bench() {
  auto read = read_rig(std::string(lightrig::test::source_dir) + "/config/wire_modbus_tcp.toml");
  if (!read.value) die("config/wire_modbus_tcp.toml is not valid");
  Rig rig = *read.value;
  rig.camera.backend = SimulatedCamera{};
  rig.camera.model.width = 32;
  rig.camera.model.height = 24;
  rig.session_defaults.object.shape = "sphere";
  return rig;
}

/// Requests to the controller and its answers as the kernel saw them.
class Sniffer {
 public:
  struct Seen {
    double time_us = 0;
    std::uint8_t function = 0;
    bool answer = false;
  };
  // What goes out is shown to sockets of every protocol alone, not to those of one.
  Sniffer() : socket_(socket(AF_PACKET, SOCK_DGRAM, htons(ETH_P_ALL))) {
    const int on = 1;
    const timeval patience{0, 50000};
    if (socket_ < 0 || setsockopt(socket_, SOL_SOCKET, SO_TIMESTAMPNS, &on, sizeof on) != 0)
      die("no raw socket to be had: run as root");
    setsockopt(socket_, SOL_SOCKET, SO_RCVTIMEO, &patience, sizeof patience);
    thread_ = std::jthread([this](const std::stop_token& stop) {
      while (!stop.stop_requested()) take_one();
    });
  }
  ~Sniffer() {
    thread_.request_stop();
    thread_.join();
    close(socket_);
  }
  Sniffer(const Sniffer&) = delete;
  Sniffer& operator=(const Sniffer&) = delete;

  std::vector<Seen> take() {
    const std::lock_guard lock(mutex_);
    return std::exchange(seen_, {});
  }

 private:
  void take_one() {
    std::array<std::uint8_t, 2048> bytes{};
    std::array<char, 256> control{};
    sockaddr_ll from{};
    iovec part{bytes.data(), bytes.size()};
    msghdr message{&from, sizeof from, &part, 1, control.data(), control.size(), 0};
    const ssize_t got = recvmsg(socket_, &message, 0);
    // On loopback every packet is seen twice: going out is when it is on the wire.
    if (got < 60 - 14 || from.sll_pkttype != PACKET_OUTGOING ||
        from.sll_protocol != htons(ETH_P_IP))
      return;
    const std::size_t ip = std::size_t{4} * (bytes[0] & 0x0fU);
    const std::size_t data = ip + std::size_t{4} * (bytes[ip + 12] >> 4U);
    const int source = (bytes[ip] << 8) | bytes[ip + 1];
    const int destination = (bytes[ip + 2] << 8) | bytes[ip + 3];
    if (bytes[9] != IPPROTO_TCP || (destination != port && source != port) ||
        data + 8 > static_cast<std::size_t>(got))
      return;
    for (cmsghdr* c = CMSG_FIRSTHDR(&message); c != nullptr; c = CMSG_NXTHDR(&message, c)) {
      if (c->cmsg_level != SOL_SOCKET || c->cmsg_type != SO_TIMESTAMPNS) continue;
      timespec time{};
      std::memcpy(&time, CMSG_DATA(c), sizeof time);
      const double us =
          1e6 * static_cast<double>(time.tv_sec % 100000) + static_cast<double>(time.tv_nsec) / 1e3;
      const std::lock_guard lock(mutex_);
      seen_.push_back({us, bytes[data + 7], source == port});
    }
  }

  int socket_;
  std::mutex mutex_;
  std::vector<Seen> seen_;
  std::jthread thread_;
};

double quantile(std::vector<double> values, double q) {
  std::sort(values.begin(), values.end());
  const auto at = static_cast<std::size_t>(std::ceil(q * static_cast<double>(values.size())));
  return values[std::clamp<std::size_t>(at, 1, values.size()) - 1];
}

double cpu_seconds() {
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  const auto seconds = [](const timeval& t) {
    return static_cast<double>(t.tv_sec) + 1e-6 * static_cast<double>(t.tv_usec);
  };
  return seconds(usage.ru_utime) + seconds(usage.ru_stime);
}

GantryPosition at_degrees(double azimuth, double elevation) {
  GantryPosition position;
  position.axes.resize(2);
  position.axes << azimuth * degree, elevation * degree;
  return position;
}

/// The controller, in a process of its own until it is killed.
pid_t host_in_child(const Rig& rig) {
  const pid_t child = fork();
  if (child != 0) return child;
  prctl(PR_SET_PDEATHSIG, SIGKILL);
  auto hosted = sim::host_rig(rig, rig.session_defaults.object, 1);
  if (!hosted) die(hosted.error().message);
  pause();
  std::_Exit(0);
}

void measure(int count, const Rig& rig) {
  RealClock clock;
  const auto& backend = std::get<ModbusGantry>(rig.gantry.backend);
  auto opened = open_gantry(rig, backend, clock);
  for (int attempt = 0; attempt < 100 && !opened; ++attempt) {
    std::this_thread::sleep_for(100ms);
    opened = open_gantry(rig, backend, clock);
  }
  if (!opened) die(opened.error().message);
  const auto soon = [&](std::chrono::seconds time) { return Until{clock.now() + time, {}}; };
  if (auto homed = opened->gantry->home(soon(60s)); !homed) die(homed.error().message);

  std::vector<double> first, motion, own;
  {
    Sniffer sniffer;
    for (int i = 0; i < count; ++i) {
      sniffer.take();
      const double called = now_us();
      const auto moved = opened->gantry->move_to(at_degrees(i % 2 == 0 ? 0.2 : 0, 10), soon(20s));
      if (!moved) die(moved.error().message);
      std::this_thread::sleep_for(5ms);
      const auto seen = sniffer.take();
      const auto after = [&](const auto& good) {
        for (const Sniffer::Seen& one : seen)
          if (one.time_us >= called && good(one)) return one.time_us - called;
        die("a packet was not seen");
      };
      first.push_back(after([](const Sniffer::Seen& one) { return !one.answer; }));
      motion.push_back(after(
          [](const Sniffer::Seen& one) { return !one.answer && one.function == write_registers; }));
      // The driver's own part: less what the controller took for its answers.
      double mine = 0, since = called;
      for (const Sniffer::Seen& one : seen) {
        if (one.time_us < called) continue;
        if (!one.answer) mine += one.time_us - since;
        if (!one.answer && one.function == write_registers) break;
        since = one.time_us;
      }
      own.push_back(mine);
    }
  }
  const double cpu = cpu_seconds();
  const auto began = std::chrono::steady_clock::now();
  if (auto moved = opened->gantry->move_to(at_degrees(160, 80), soon(60s)); !moved)
    die(moved.error().message);
  const double wall =
      std::chrono::duration<double>(std::chrono::steady_clock::now() - began).count();
  const double percent = 100 * (cpu_seconds() - cpu) / wall;

  std::printf("%-44s %10s %10s %10s\n", "microseconds after the call", "p50", "p99", "worst");
  const auto row = [](const char* name, const std::vector<double>& values) {
    std::printf("%-44s %10.0f %10.0f %10.0f\n", name, quantile(values, 0.5), quantile(values, 0.99),
                quantile(values, 1));
  };
  row("first byte (where are you?)", first);
  row("motion write, after the status of two drives", motion);
  row("the same less the controller's own time", own);
  std::printf("polling a move of %.1f s: %.2f %% of one core, driver's process alone\n", wall,
              percent);
  std::printf(
      "moves=%d first_p50_us=%.0f first_p99_us=%.0f motion_p50_us=%.0f motion_p99_us=%.0f "
      "own_p50_us=%.0f own_p99_us=%.0f poll_cpu_percent=%.2f\n",
      count, quantile(first, 0.5), quantile(first, 0.99), quantile(motion, 0.5),
      quantile(motion, 0.99), quantile(own, 0.5), quantile(own, 0.99), percent);
}

}  // namespace
}  // namespace lightrig

int main(int argc, char** argv) {
  using namespace lightrig;
  const int count = argc == 3 && std::string(argv[1]) == "--count" ? std::atoi(argv[2]) : 300;
  if (argc != 1 && (argc != 3 || count < 1)) die("usage: wire_latency [--count N]");
  if (const std::string obstacle = test::enter_own_network(); !obstacle.empty()) die(obstacle);
  const Rig rig = rig_of_bench();
  const pid_t controller = host_in_child(rig);
  measure(count, rig);
  kill(controller, SIGKILL);
  waitpid(controller, nullptr, 0);
  return 0;
}
