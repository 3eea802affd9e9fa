#include "sim/modbus/modbus_server.h"

#include <arpa/inet.h>
#include <fcntl.h>
#include <fmt/format.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <pty.h>
#include <sys/socket.h>
#include <termios.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <cstring>
#include <filesystem>

#include "sim/hosted_wire.h"
#include "sim/modbus/modbus_pdu.h"

namespace lightrig::sim {
namespace {

constexpr int poll_ms = 20;
constexpr std::size_t mbap_bytes = 7;
constexpr std::size_t most_clients = 8;

tl::unexpected<Error> refused(const std::string& doing) {
  return fail(ErrorCode::refused, fmt::format("{}: {}", doing, std::strerror(errno)));
}

}  // namespace

Result<std::unique_ptr<ModbusServer>> ModbusServer::open(const Endpoint& endpoint, Units units) {
  auto server = std::unique_ptr<ModbusServer>(new ModbusServer(std::move(units)));
  ModbusServer* raw = server.get();
  if (const auto* tcp = std::get_if<TcpEndpoint>(&endpoint)) {
    if (auto open = server->listen(*tcp); !open) return tl::unexpected(open.error());
    server->thread_ = std::jthread([raw](const std::stop_token& stop) { raw->serve_tcp(stop); });
  } else {
    if (auto open = server->open_pty(std::get<SerialEndpoint>(endpoint)); !open)
      return tl::unexpected(open.error());
    server->thread_ = std::jthread([raw](const std::stop_token& stop) { raw->serve_rtu(stop); });
  }
  return server;
}

ModbusServer::~ModbusServer() {
  if (thread_.joinable()) {
    thread_.request_stop();
    thread_.join();
  }
  for (int descriptor : {listener_, master_, slave_})
    if (descriptor >= 0) close(descriptor);
  if (!link_.empty()) std::filesystem::remove(link_);
}

Result<void> ModbusServer::listen(const TcpEndpoint& endpoint) {
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_port = htons(static_cast<std::uint16_t>(endpoint.port));
  if (inet_pton(AF_INET, endpoint.host.c_str(), &address.sin_addr) != 1)
    return fail(
        ErrorCode::invalid_input,
        fmt::format("host a Modbus controller at \"{}\": give an IPv4 address of this machine",
                    endpoint.host));
  listener_ = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
  const int on = 1;
  setsockopt(listener_, SOL_SOCKET, SO_REUSEADDR, &on, sizeof on);
  socklen_t size = sizeof address;
  if (bind(listener_, reinterpret_cast<sockaddr*>(&address), size) != 0 ||
      ::listen(listener_, 8) != 0)
    return refused(fmt::format("listen at {}:{}", endpoint.host, endpoint.port));
  getsockname(listener_, reinterpret_cast<sockaddr*>(&address), &size);
  address_ = fmt::format("{}:{}", endpoint.host, ntohs(address.sin_port));
  return {};
}

Result<void> ModbusServer::open_pty(const SerialEndpoint& endpoint) {
  std::array<char, 128> name{};
  termios raw{};
  cfmakeraw(&raw);
  if (openpty(&master_, &slave_, name.data(), &raw, nullptr) != 0) return refused("open a pty");
  fcntl(master_, F_SETFL, O_NONBLOCK);
  address_ = name.data();
  if (endpoint.device.empty()) return {};
  std::error_code error;
  if (std::filesystem::is_symlink(endpoint.device, error))
    std::filesystem::remove(endpoint.device, error);
  std::filesystem::create_symlink(address_, endpoint.device, error);
  if (error)
    return fail(ErrorCode::refused, fmt::format("link {} to the pty {}: {}", endpoint.device,
                                                address_, error.message()));
  link_ = endpoint.device;
  return {};
}

// One whole request at a time; false when the client is to be dropped.
bool ModbusServer::answer_tcp(int client, Bytes& pending) {
  while (pending.size() >= mbap_bytes) {
    const std::size_t length = static_cast<std::size_t>((pending[4] << 8) | pending[5]);
    if (pending[2] != 0 || pending[3] != 0 || length < 2 || length > 254) return false;
    if (pending.size() < 6 + length) return true;
    const auto unit = units_.find(pending[6]);
    Bytes answer(pending.begin(), pending.begin() + 7);
    if (unit == units_.end()) {
      answer.insert(answer.end(),
                    {static_cast<std::uint8_t>(pending[7] | 0x80), 0x0b});  // gateway: no such unit
    } else {
      const Bytes pdu = answer_pdu(*unit->second, std::span(pending).subspan(7, length - 1));
      answer.insert(answer.end(), pdu.begin(), pdu.end());
    }
    const std::size_t answered = answer.size() - 6;
    answer[4] = static_cast<std::uint8_t>(answered >> 8);
    answer[5] = static_cast<std::uint8_t>(answered & 0xff);
    if (send(client, answer.data(), answer.size(), MSG_NOSIGNAL) < 0) return false;
    pending.erase(pending.begin(), pending.begin() + static_cast<std::ptrdiff_t>(6 + length));
  }
  return true;
}

void ModbusServer::serve_tcp(const std::stop_token& stop) {
  struct Client {
    int descriptor;
    Bytes pending;
  };
  std::vector<Client> clients;
  while (!stop.stop_requested()) {
    std::vector<pollfd> watch{{listener_, POLLIN, 0}};
    for (const Client& client : clients) watch.push_back({client.descriptor, POLLIN, 0});
    if (poll(watch.data(), watch.size(), poll_ms) <= 0) continue;
    for (std::size_t i = clients.size(); i-- > 0;) {
      if (watch[i + 1].revents == 0) continue;
      std::array<std::uint8_t, 1024> buffer{};
      const ssize_t got = recv(clients[i].descriptor, buffer.data(), buffer.size(), 0);
      bool keep = got > 0;
      if (keep) {
        clients[i].pending.insert(clients[i].pending.end(), buffer.begin(), buffer.begin() + got);
        keep = answer_tcp(clients[i].descriptor, clients[i].pending);
      }
      if (keep) continue;
      close(clients[i].descriptor);
      clients.erase(clients.begin() + static_cast<std::ptrdiff_t>(i));
    }
    if (watch[0].revents == 0) continue;
    const int accepted = accept4(listener_, nullptr, nullptr, SOCK_CLOEXEC);
    if (accepted < 0) continue;
    if (clients.size() >= most_clients) {
      close(accepted);
      continue;
    }
    const int on = 1;
    setsockopt(accepted, IPPROTO_TCP, TCP_NODELAY, &on, sizeof on);
    clients.push_back({accepted, {}});
  }
  for (const Client& client : clients) close(client.descriptor);
}

void ModbusServer::answer_rtu(Bytes& pending) {
  for (;;) {
    const auto length = rtu_request_length(pending);
    if (!length) return;
    if (*length == 0) {
      pending.clear();  // no request: wait for silence, as a drive does
      return;
    }
    if (pending.size() < *length) return;
    const std::span<const std::uint8_t> request(pending.data(), *length - 2);
    const std::uint16_t crc = crc16(request);
    const bool sound = pending[*length - 2] == (crc & 0xff) && pending[*length - 1] == (crc >> 8);
    const auto unit = units_.find(pending[0]);
    if (sound && unit != units_.end()) {
      Bytes answer{pending[0]};
      const Bytes pdu = answer_pdu(*unit->second, request.subspan(1));
      answer.insert(answer.end(), pdu.begin(), pdu.end());
      const std::uint16_t check = crc16(answer);
      answer.push_back(static_cast<std::uint8_t>(check & 0xff));
      answer.push_back(static_cast<std::uint8_t>(check >> 8));
      if (write(master_, answer.data(), answer.size()) < 0) return;
    }
    if (!sound) {
      pending.clear();
      return;
    }
    pending.erase(pending.begin(), pending.begin() + static_cast<std::ptrdiff_t>(*length));
  }
}

void ModbusServer::serve_rtu(const std::stop_token& stop) {
  Bytes pending;
  while (!stop.stop_requested()) {
    pollfd watch{master_, POLLIN, 0};
    if (poll(&watch, 1, poll_ms) <= 0) {
      pending.clear();  // silence ends a frame that never became whole
      continue;
    }
    std::array<std::uint8_t, 512> buffer{};
    const ssize_t got = read(master_, buffer.data(), buffer.size());
    if (got <= 0) {
      std::this_thread::sleep_for(std::chrono::milliseconds(poll_ms));
      continue;
    }
    pending.insert(pending.end(), buffer.begin(), buffer.begin() + got);
    answer_rtu(pending);
  }
}

Result<std::vector<HostedWire>> host_wire(const Rig&, const ModbusGantry& backend,
                                          std::shared_ptr<World> world) {
  std::vector<HostedWire> hosted;
  std::vector<bool> done(backend.drives.size(), false);
  for (std::size_t i = 0; i < backend.drives.size(); ++i) {
    if (done[i]) continue;
    // All drives on the same wire are units of one server.
    const auto same = [&](const ModbusDrive& other) {
      if (other.endpoint.index() != backend.drives[i].endpoint.index()) return false;
      if (const auto* tcp = std::get_if<TcpEndpoint>(&other.endpoint)) {
        const auto& mine = std::get<TcpEndpoint>(backend.drives[i].endpoint);
        return tcp->host == mine.host && tcp->port == mine.port;
      }
      return std::get<SerialEndpoint>(other.endpoint).device ==
             std::get<SerialEndpoint>(backend.drives[i].endpoint).device;
    };
    ModbusServer::Units units;
    for (std::size_t j = i; j < backend.drives.size(); ++j) {
      if (!same(backend.drives[j])) continue;
      units[backend.drives[j].unit] = std::make_unique<DriveRegisters>(backend, j, world);
      done[j] = true;
    }
    auto server = ModbusServer::open(backend.drives[i].endpoint, std::move(units));
    if (!server) return tl::unexpected(with_context("simulate the gantry", server.error()));
    std::shared_ptr<ModbusServer> shared = std::move(*server);
    hosted.push_back({"gantry", shared->address(), shared});
  }
  return hosted;
}

}  // namespace lightrig::sim
