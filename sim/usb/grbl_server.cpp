// A GRBL controller on a pty.
#include <fcntl.h>
#include <fmt/format.h>
#include <poll.h>
#include <pty.h>
#include <termios.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <cstring>
#include <filesystem>
#include <thread>

#include "sim/hosted_wire.h"
#include "sim/usb/grbl_far_end.h"
#include "sim/usb/usb_far_end.h"

namespace lightrig::sim {
namespace {

using std::chrono::steady_clock;

constexpr int poll_ms = 5;

class GrblPty {
 public:
  GrblPty(const GrblGantry& backend, std::shared_ptr<World> world,
          std::shared_ptr<WireFaults> faults)
      : far_end_(backend, std::move(world), std::move(faults)) {}
  ~GrblPty() {
    if (thread_.joinable()) {
      thread_.request_stop();
      thread_.join();
    }
    close_pty();
  }
  GrblPty(const GrblPty&) = delete;
  GrblPty& operator=(const GrblPty&) = delete;

  Result<std::string> open(const SerialEndpoint& endpoint) {
    endpoint_ = endpoint;
    auto name = open_pty();
    if (name) thread_ = std::jthread([this](const std::stop_token& stop) { serve(stop); });
    return name;
  }

 private:
  Result<std::string> open_pty() {
    std::array<char, 128> name{};
    termios raw{};
    cfmakeraw(&raw);
    if (openpty(&master_, &slave_, name.data(), &raw, nullptr) != 0)
      return fail(ErrorCode::refused, fmt::format("open a pty: {}", std::strerror(errno)));
    fcntl(master_, F_SETFL, O_NONBLOCK);
    if (endpoint_.device.empty()) return std::string(name.data());
    std::error_code error;
    if (std::filesystem::is_symlink(endpoint_.device, error))
      std::filesystem::remove(endpoint_.device, error);
    std::filesystem::create_symlink(name.data(), endpoint_.device, error);
    if (error)
      return fail(ErrorCode::refused, fmt::format("link {} to the pty {}: {}", endpoint_.device,
                                                  name.data(), error.message()));
    link_ = endpoint_.device;
    return std::string(name.data());
  }

  void close_pty() {
    for (int* descriptor : {&master_, &slave_}) {
      if (*descriptor >= 0) close(*descriptor);
      *descriptor = -1;
    }
    std::error_code ignored;
    if (!link_.empty()) std::filesystem::remove(link_, ignored);
    link_.clear();
  }

  void serve(const std::stop_token& stop) {
    while (!stop.stop_requested()) {
      pollfd watch{master_, POLLIN, 0};
      const int ready = master_ >= 0 ? poll(&watch, 1, poll_ms) : 0;
      if (master_ < 0) std::this_thread::sleep_for(std::chrono::milliseconds(poll_ms));
      if (ready > 0) {
        std::array<char, 256> buffer{};
        const ssize_t got = read(master_, buffer.data(), buffer.size());
        if (got > 0) far_end_.receive({buffer.data(), static_cast<std::size_t>(got)});
      }
      const auto fault = far_end_.tick();
      if (fault && fault->effect == WireEffect::unplug) {
        close_pty();
        gone_until_ = steady_clock::now() + fault->duration;
      }
      // Plugged in again it is a new pty; where the rig names a path it is found there.
      if (master_ < 0 && steady_clock::now() >= gone_until_) (void)open_pty();
      const std::string said = far_end_.take();
      if (said.empty() || master_ < 0) continue;
      if (write(master_, said.data(), said.size()) < 0) continue;  // nobody listens
    }
  }

  GrblFarEnd far_end_;
  SerialEndpoint endpoint_;
  int master_ = -1, slave_ = -1;  // the slave is held open: a pty whose slave nobody holds hangs up
  std::string link_;
  steady_clock::time_point gone_until_{};
  std::jthread thread_;
};

}  // namespace

Result<std::vector<HostedWire>> host_wire(const Rig&, const GrblGantry& backend,
                                          std::shared_ptr<World> world,
                                          std::shared_ptr<WireFaults> faults) {
  const auto* serial = std::get_if<SerialEndpoint>(&backend.endpoint);
  if (!serial) {
    const auto& usb = std::get<UsbEndpoint>(backend.endpoint);
    auto device = UsbFarEnd::open(usb, GrblFarEnd(backend, std::move(world), std::move(faults)));
    if (!device) return tl::unexpected(with_context("simulate the gantry", device.error()));
    std::shared_ptr<UsbFarEnd> shared = std::move(*device);
    const std::string address = fmt::format("USB {:04x}:{:04x} serial {}", usb.vendor, usb.product,
                                            usb.serial.empty() ? "(none)" : usb.serial);
    return std::vector<HostedWire>{
        {"gantry",
         address,
         shared,
         {{"LD_PRELOAD", "libumockdev-preload.so.0"}, {"UMOCKDEV_DIR", shared->folder()}},
         [shared] { return shared->history(); }}};
  }
  auto pty = std::make_shared<GrblPty>(backend, std::move(world), std::move(faults));
  auto name = pty->open(*serial);
  if (!name) return tl::unexpected(with_context("simulate the gantry", name.error()));
  return std::vector<HostedWire>{{"gantry", *name, pty, {}, {}}};
}

}  // namespace lightrig::sim
