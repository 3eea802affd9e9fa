// A GRBL controller on a pty.
#include <fmt/format.h>
#include <poll.h>
#include <unistd.h>

#include <array>
#include <thread>

#include "sim/hosted_wire.h"
#include "sim/pty.h"
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
  }
  GrblPty(const GrblPty&) = delete;
  GrblPty& operator=(const GrblPty&) = delete;

  Result<std::string> open(const SerialEndpoint& endpoint) {
    endpoint_ = endpoint;
    auto name = pty_.open(endpoint_.device);
    if (name) thread_ = std::jthread([this](const std::stop_token& stop) { serve(stop); });
    return name;
  }

 private:
  void serve(const std::stop_token& stop) {
    while (!stop.stop_requested()) {
      pollfd watch{pty_.descriptor(), POLLIN, 0};
      const int ready = pty_.is_open() ? poll(&watch, 1, poll_ms) : 0;
      if (!pty_.is_open()) std::this_thread::sleep_for(std::chrono::milliseconds(poll_ms));
      if (ready > 0) {
        std::array<char, 256> buffer{};
        const ssize_t got = read(pty_.descriptor(), buffer.data(), buffer.size());
        if (got > 0) far_end_.receive({buffer.data(), static_cast<std::size_t>(got)});
      }
      const auto fault = far_end_.tick();
      if (fault && fault->effect == WireEffect::unplug) {
        pty_.close();
        gone_until_ = steady_clock::now() + fault->duration;
      }
      // Plugged in again it is a new pty; where the rig names a path it is found there.
      if (!pty_.is_open() && steady_clock::now() >= gone_until_) (void)pty_.open(endpoint_.device);
      const std::string said = far_end_.take();
      if (said.empty() || !pty_.is_open()) continue;
      if (write(pty_.descriptor(), said.data(), said.size()) < 0) continue;  // nobody listens
    }
  }

  GrblFarEnd far_end_;
  SerialEndpoint endpoint_;
  Pty pty_;
  steady_clock::time_point gone_until_{};
  std::jthread thread_;
};

/// `backend` as GrblMachine's.
Result<std::vector<HostedWire>> host(const char* part, const GrblGantry& backend,
                                     std::shared_ptr<World> world,
                                     std::shared_ptr<WireFaults> faults) {
  const std::string doing = fmt::format("simulate the {}", part);
  const auto* serial = std::get_if<SerialEndpoint>(&backend.endpoint);
  if (!serial) {
    const auto& usb = std::get<UsbEndpoint>(backend.endpoint);
    auto device = UsbFarEnd::open(usb, GrblFarEnd(backend, std::move(world), std::move(faults)));
    if (!device) return tl::unexpected(with_context(doing, device.error()));
    std::shared_ptr<UsbFarEnd> shared = std::move(*device);
    const std::string address = fmt::format("USB {:04x}:{:04x} serial {}", usb.vendor, usb.product,
                                            usb.serial.empty() ? "(none)" : usb.serial);
    return std::vector<HostedWire>{
        {part,
         address,
         shared,
         {{"LD_PRELOAD", "libumockdev-preload.so.0"}, {"UMOCKDEV_DIR", shared->folder()}},
         [shared] { return shared->history(); }}};
  }
  auto pty = std::make_shared<GrblPty>(backend, std::move(world), std::move(faults));
  auto name = pty->open(*serial);
  if (!name) return tl::unexpected(with_context(doing, name.error()));
  return std::vector<HostedWire>{{part, *name, pty, {}, {}}};
}

}  // namespace

Result<std::vector<HostedWire>> host_wire(const Rig&, const GrblGantry& backend,
                                          std::shared_ptr<World> world,
                                          std::shared_ptr<WireFaults> faults) {
  return host("gantry", backend, std::move(world), std::move(faults));
}

Result<std::vector<HostedWire>> host_wire(const Rig& rig, const GrblLamp& backend,
                                          std::shared_ptr<World> world,
                                          std::shared_ptr<WireFaults> faults) {
  const auto* gantry = std::get_if<GrblGantry>(&rig.gantry.backend);
  if (gantry && std::holds_alternative<UsbEndpoint>(gantry->endpoint) &&
      std::holds_alternative<UsbEndpoint>(backend.endpoint))
    return fail(ErrorCode::refused,
                "simulate the lamp: one USB device can be emulated at a time, and that is the "
                "gantry's; give [lamp.grbl] a device path for the rehearsal");
  GrblGantry without_axes;
  without_axes.endpoint = backend.endpoint;
  return host("lamp", without_axes, std::move(world), std::move(faults));
}

}  // namespace lightrig::sim
