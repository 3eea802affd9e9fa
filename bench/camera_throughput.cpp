// Frames per second through the production camera driver, from a simulated GigE Vision camera in
// another process, over the loopback of a network of its own: without loss, and at what processor
// time. Two cases: 1280 × 1024 at 12 bits and 30 frames per second, 5 megapixels at 15; each as
// fast as it goes, too. Exits 1 when a frame is lost or the rate is not reached.
#include <fmt/format.h>
#include <signal.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <cstdlib>
#include <fstream>
#include <string>
#include <thread>

#include "drivers/backends.h"
#include "sim/aravis/gv_camera.h"
#include "tests/drivers/own_network.h"

namespace lightrig {
namespace {

using std::chrono::steady_clock;

struct Case {
  const char* name;
  int width, height;
  const char* format;
  double rate;       ///< [1/s] asked for; 0: as fast as it goes
  double link_rate;  ///< [byte/s] of the camera's link
};

constexpr double exposure = 1e-3;  // [s]
constexpr double gigabit = 125e6, two_and_a_half_gigabit = 312.5e6, ten_gigabit = 1.25e9;

double processor_seconds(int who) {
  rusage use{};
  getrusage(who, &use);
  const auto seconds = [](const timeval& t) {
    return static_cast<double>(t.tv_sec) + 1e-6 * static_cast<double>(t.tv_usec);
  };
  return seconds(use.ru_utime) + seconds(use.ru_stime);
}

/// The camera's process: the same picture again and again, so that rendering is not measured.
[[noreturn]] void be_a_camera(const Case& one) {
  prctl(PR_SET_PDEATHSIG, SIGKILL);
  sim::CameraBody body;
  body.width = one.width;
  body.height = one.height;
  body.min_exposure = 1e-5;
  body.max_exposure = 1;
  body.link_rate = one.link_rate;
  Frame frame;
  frame.counts = {one.width, one.height, {}};
  frame.counts.counts.resize(static_cast<std::size_t>(one.width) *
                             static_cast<std::size_t>(one.height));
  for (std::size_t i = 0; i < frame.counts.counts.size(); ++i)
    frame.counts.counts[i] = static_cast<std::uint16_t>(i * 2654435761U >> 20 & 0xfff);
  RealClock clock;
  const auto camera = sim::GvCamera::open(
      body, [&](double, const std::stop_token&) -> Result<Frame> { return frame; }, clock, nullptr);
  if (!camera) {
    fmt::print(stderr, "{}\n", camera.error().message);
    _exit(1);
  }
  pause();
  _exit(0);
}

struct Figures {
  double rate = 0, driver_cpu = 0, camera_cpu = 0, bytes_per_second = 0;
  std::uint64_t frames = 0, refused = 0, resent = 0;
  std::string failure;
};

Figures measure(const Case& one, double seconds) {
  Figures figures;
  const pid_t camera_process = fork();
  if (camera_process == 0) be_a_camera(one);
  Rig rig;
  rig.camera.model.width = one.width;
  rig.camera.model.height = one.height;
  rig.camera.sensor.bits = 12;
  rig.camera.sensor.min_exposure = 1e-5;
  rig.camera.sensor.max_exposure = 1;
  AravisCamera backend;
  backend.id = "127.0.0.1";
  backend.pixel_format = one.format;
  backend.trigger = "software";
  std::ifstream("/proc/sys/net/core/rmem_max") >> backend.socket_buffer_bytes;
  RealClock clock;
  Result<std::unique_ptr<Camera>> camera = fail(ErrorCode::not_found, "not tried");
  for (int attempt = 0; attempt < 20 && !camera; ++attempt) {
    std::this_thread::sleep_for(std::chrono::milliseconds(100));
    camera = open_camera(rig, backend, clock);
  }
  if (camera) {
    const double before = processor_seconds(RUSAGE_SELF);
    const auto begin = steady_clock::now();
    const auto elapsed = [&] {
      return std::chrono::duration<double>(steady_clock::now() - begin).count();
    };
    while (elapsed() < seconds) {
      const Until until{clock.now() + std::chrono::seconds(5), {}};
      if (const auto frame = (*camera)->expose(exposure, until)) {
        ++figures.frames;
      } else {
        ++figures.refused;
        figures.failure = frame.error().message;
      }
      if (one.rate > 0)
        std::this_thread::sleep_until(
            begin +
            std::chrono::duration_cast<steady_clock::duration>(std::chrono::duration<double>(
                static_cast<double>(figures.frames + figures.refused) / one.rate)));
    }
    const double took = elapsed();
    figures.rate = static_cast<double>(figures.frames) / took;
    figures.driver_cpu = (processor_seconds(RUSAGE_SELF) - before) / took;
    figures.bytes_per_second =
        figures.rate *
        static_cast<double>(payload_bytes(*find_pixel_format(one.format), one.width, one.height));
    figures.resent = (*camera)->counters().packets_resent;
    const double children = processor_seconds(RUSAGE_CHILDREN);
    camera->reset();
    kill(camera_process, SIGKILL);
    waitpid(camera_process, nullptr, 0);
    figures.camera_cpu = (processor_seconds(RUSAGE_CHILDREN) - children) / took;
  } else {
    figures.failure = camera.error().message;
    kill(camera_process, SIGKILL);
    waitpid(camera_process, nullptr, 0);
  }
  return figures;
}

int run(double seconds) {
  if (const std::string obstacle = test::enter_own_network(); !obstacle.empty()) {
    fmt::print(stderr, "camera_throughput: {}\n", obstacle);
    return 2;
  }
  constexpr Case cases[] = {
      {"sxga12", 1280, 1024, "Mono12", 30, gigabit},
      {"sxga12_free", 1280, 1024, "Mono12", 0, ten_gigabit},
      {"5mp", 2448, 2048, "Mono12", 15, two_and_a_half_gigabit},
      {"5mp_packed", 2448, 2048, "Mono12p", 15, two_and_a_half_gigabit},
      {"5mp_free", 2448, 2048, "Mono12", 0, ten_gigabit},
  };
  fmt::print("{:<12} {:>12} {:>8} {:>7} {:>8} {:>7} {:>7} {:>7} {:>11} {:>11}\n", "case", "pixels",
             "format", "asked", "frames/s", "MB/s", "refused", "resent", "driver CPU",
             "camera CPU");
  std::string last;
  bool good = true;
  for (const Case& one : cases) {
    const Figures f = measure(one, seconds);
    fmt::print("{:<12} {:>12} {:>8} {:>7} {:>8.1f} {:>7.1f} {:>7} {:>7} {:>10.1f}% {:>10.1f}%\n",
               one.name, fmt::format("{}x{}", one.width, one.height), one.format,
               one.rate > 0 ? fmt::format("{}", one.rate) : "free", f.rate,
               f.bytes_per_second / 1e6, f.refused, f.resent, 100 * f.driver_cpu,
               100 * f.camera_cpu);
    if (!f.failure.empty()) fmt::print("             {}\n", f.failure);
    good = good && f.refused == 0 && f.frames > 0 && f.rate >= 0.99 * one.rate;
    last += fmt::format("{0}_fps={1:.1f} {0}_refused={2} {0}_driver_cpu={3:.3f} ", one.name, f.rate,
                        f.refused, f.driver_cpu);
  }
  fmt::print("{}ok={}\n", last, good ? 1 : 0);
  return good ? 0 : 1;
}

}  // namespace
}  // namespace lightrig

int main(int argc, char** argv) { return lightrig::run(argc > 1 ? std::atof(argv[1]) : 10); }
