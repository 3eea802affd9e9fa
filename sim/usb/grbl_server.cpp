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
#include "sim/usb/grbl_machine.h"

namespace lightrig::sim {
namespace {

constexpr int poll_ms = 5;

class GrblPty {
 public:
  GrblPty(const GrblGantry& backend, std::shared_ptr<World> world)
      : machine_(backend, std::move(world)) {}
  ~GrblPty() {
    if (thread_.joinable()) {
      thread_.request_stop();
      thread_.join();
    }
    for (int descriptor : {master_, slave_})
      if (descriptor >= 0) close(descriptor);
    if (!link_.empty()) std::filesystem::remove(link_);
  }
  GrblPty(const GrblPty&) = delete;
  GrblPty& operator=(const GrblPty&) = delete;

  Result<std::string> open(const SerialEndpoint& endpoint) {
    std::array<char, 128> name{};
    termios raw{};
    cfmakeraw(&raw);
    if (openpty(&master_, &slave_, name.data(), &raw, nullptr) != 0)
      return fail(ErrorCode::refused, fmt::format("open a pty: {}", std::strerror(errno)));
    fcntl(master_, F_SETFL, O_NONBLOCK);
    if (!endpoint.device.empty()) {
      std::error_code error;
      if (std::filesystem::is_symlink(endpoint.device, error))
        std::filesystem::remove(endpoint.device, error);
      std::filesystem::create_symlink(name.data(), endpoint.device, error);
      if (error)
        return fail(ErrorCode::refused, fmt::format("link {} to the pty {}: {}", endpoint.device,
                                                    name.data(), error.message()));
      link_ = endpoint.device;
    }
    thread_ = std::jthread([this](const std::stop_token& stop) { serve(stop); });
    return std::string(name.data());
  }

 private:
  void serve(const std::stop_token& stop) {
    while (!stop.stop_requested()) {
      pollfd watch{master_, POLLIN, 0};
      std::string said;
      if (poll(&watch, 1, poll_ms) > 0) {
        std::array<char, 256> buffer{};
        const ssize_t got = read(master_, buffer.data(), buffer.size());
        if (got > 0) said = machine_.receive({buffer.data(), static_cast<std::size_t>(got)});
      }
      said += machine_.tick();
      if (!said.empty() && write(master_, said.data(), said.size()) < 0)
        continue;  // nobody listens
    }
  }

  GrblMachine machine_;
  int master_ = -1, slave_ = -1;  // the slave is held open: a pty whose slave nobody holds hangs up
  std::string link_;
  std::jthread thread_;
};

}  // namespace

Result<std::vector<HostedWire>> host_wire(const Rig&, const GrblGantry& backend,
                                          std::shared_ptr<World> world) {
  const auto* serial = std::get_if<SerialEndpoint>(&backend.endpoint);
  if (!serial)
    return fail(ErrorCode::not_built,
                "a simulated USB device needs an emulated usbfs; name a serial device in "
                "[gantry.grbl] to simulate the same controller on a pty");
  auto pty = std::make_shared<GrblPty>(backend, std::move(world));
  auto name = pty->open(*serial);
  if (!name) return tl::unexpected(with_context("simulate the gantry", name.error()));
  return std::vector<HostedWire>{{"gantry", *name, pty}};
}

}  // namespace lightrig::sim
