#include "sim/modbus/modbus_server.h"

#include <arpa/inet.h>
#include <fmt/format.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>

#include "sim/modbus/spoiled_answer.h"

namespace lightrig::sim {
namespace {

using std::chrono::steady_clock;

constexpr int poll_ms = 5;
constexpr auto frame_silence = std::chrono::milliseconds(50);  ///< ends an RTU frame never whole
constexpr std::size_t mbap_bytes = 7;
constexpr std::size_t most_clients = 8;
constexpr std::uint8_t no_such_unit = 0x0b;  ///< gateway: target device failed to respond

tl::unexpected<Error> not_listening(const TcpEndpoint& endpoint) {
  const int why = errno;
  const char* remedy = "";
  if (why == EADDRINUSE)
    remedy =
        "; another program has that port, perhaps another simulation of this rig: end it (ss -ltnp "
        "names it), or give the rig file another port";
  if (why == EACCES) remedy = "; ports below 1024 are root's: give the rig file another port";
  if (why == EADDRNOTAVAIL)
    remedy = "; this machine has no such address: give the rig file one that it has, as 127.0.0.1";
  return fail(ErrorCode::refused, fmt::format("listen at {}:{}: {}{}", endpoint.host, endpoint.port,
                                              std::strerror(why), remedy));
}

}  // namespace

Result<std::unique_ptr<ModbusServer>> ModbusServer::open(const Endpoint& endpoint, Units units,
                                                         std::shared_ptr<WireFaults> faults,
                                                         Wire wire) {
  auto server = std::unique_ptr<ModbusServer>(
      new ModbusServer(endpoint, std::move(units), std::move(faults), wire));
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
  for (const Client& client : clients_) close(client.descriptor);
  if (listener_ >= 0) close(listener_);
  pty_.close();
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
    return not_listening(endpoint);
  getsockname(listener_, reinterpret_cast<sockaddr*>(&address), &size);
  address_ = fmt::format("{}:{}", endpoint.host, ntohs(address.sin_port));
  return {};
}

Result<void> ModbusServer::open_pty(const SerialEndpoint& endpoint) {
  auto name = pty_.open(endpoint.device);
  if (!name) return tl::unexpected(name.error());
  address_ = *name;
  return {};
}

Bytes ModbusServer::framed(const Bytes& head, const Bytes& pdu) const {
  Bytes answer = head;
  answer.insert(answer.end(), pdu.begin(), pdu.end());
  if (is_tcp()) {
    const std::size_t length = answer.size() - 6;
    answer[4] = static_cast<std::uint8_t>(length >> 8);
    answer[5] = static_cast<std::uint8_t>(length & 0xff);
  } else {
    const std::uint16_t crc = crc16(answer);
    answer.push_back(static_cast<std::uint8_t>(crc & 0xff));
    answer.push_back(static_cast<std::uint8_t>(crc >> 8));
  }
  return answer;
}

// One sound request: obeyed, answered, or spoiled as a fault says. False when the connection is to
// be closed.
bool ModbusServer::serve(std::uint64_t client, std::uint8_t unit, const Bytes& head,
                         std::span<const std::uint8_t> pdu) {
  const auto found = units_.find(unit);
  if (found == units_.end()) {
    // On a serial line nobody answers for a unit that is not there; a TCP gateway says so.
    if (is_tcp())
      outbox_.push_back({steady_clock::now(), client,
                         framed(head, {static_cast<std::uint8_t>(pdu[0] | 0x80), no_such_unit})});
    return true;
  }
  const auto fault = faults_ ? faults_->on_request(wire_, unit) : std::nullopt;
  if (steady_clock::now() < silent_until_) return true;
  // A drive that wants silence after its answer does not hear what comes earlier.
  if (!is_tcp() && steady_clock::now() < last_answer_ + found->second->gap()) return true;
  found->second->heard();
  if (fault && fault->effect == WireEffect::silence) return true;
  Bytes answer;
  if (fault && fault->effect == WireEffect::exception) {
    const int code = fault->code > 0 ? fault->code : 4;
    answer = {static_cast<std::uint8_t>(pdu[0] | 0x80), static_cast<std::uint8_t>(code)};
  } else {
    answer = answer_pdu(*found->second, pdu);
  }
  const Bytes whole = framed(head, answer);
  const auto now = steady_clock::now();
  if (!fault) {
    outbox_.push_back({now, client, whole});
    return true;
  }
  for (LateBytes& late : spoiled(whole, *fault, is_tcp()))
    outbox_.push_back({now + late.delay, client, std::move(late.bytes)});
  return fault->effect != WireEffect::closed;
}

// One whole request at a time; false when the client is to be dropped.
bool ModbusServer::answer_tcp(Client& client) {
  Bytes& pending = client.pending;
  while (pending.size() >= mbap_bytes) {
    const std::size_t length = static_cast<std::size_t>((pending[4] << 8) | pending[5]);
    if (pending[2] != 0 || pending[3] != 0 || length < 2 || length > 254) return false;
    if (pending.size() < 6 + length) return true;
    const Bytes request(pending.begin(), pending.begin() + static_cast<std::ptrdiff_t>(6 + length));
    pending.erase(pending.begin(), pending.begin() + static_cast<std::ptrdiff_t>(6 + length));
    const Bytes head(request.begin(), request.begin() + mbap_bytes);
    if (!serve(client.number, request[6], head, std::span(request).subspan(mbap_bytes)))
      return false;
    send_due();
  }
  return true;
}

void ModbusServer::drop(std::uint64_t number) {
  for (const Client& client : clients_)
    if (client.number == number) close(client.descriptor);
  std::erase_if(clients_, [&](const Client& client) { return client.number == number; });
  std::erase_if(outbox_, [&](const Outgoing& one) { return one.client == number; });
}

void ModbusServer::transmit(const Outgoing& outgoing) {
  if (outgoing.client == 0) {
    last_answer_ = steady_clock::now();
    if (pty_.is_open() &&
        write(pty_.descriptor(), outgoing.bytes.data(), outgoing.bytes.size()) < 0)
      return;  // nobody reads the pty: a serial line loses what nobody takes
    return;
  }
  for (const Client& client : clients_)
    if (client.number == outgoing.client &&
        send(client.descriptor, outgoing.bytes.data(), outgoing.bytes.size(), MSG_NOSIGNAL) < 0)
      return;  // it is gone; the next poll says so
}

void ModbusServer::send_due() {
  const auto now = steady_clock::now();
  for (auto one = outbox_.begin(); one != outbox_.end();) {
    if (one->time > now) {
      ++one;
      continue;
    }
    transmit(*one);
    one = outbox_.erase(one);
  }
}

// What strikes the wire itself, and the drives' own sense of time.
void ModbusServer::tick() {
  const auto fault = faults_ ? faults_->tick(wire_) : std::nullopt;
  const auto now = steady_clock::now();
  if (fault && fault->effect == WireEffect::reboot) {
    for (auto& [number, unit] : units_) unit->reboot();
    silent_until_ = now + fault->duration;
    outbox_.clear();
  }
  if (fault && fault->effect == WireEffect::half_open)
    for (Client& client : clients_) client.deaf = true;
  if (fault && fault->effect == WireEffect::unplug) {
    gone_until_ = now + fault->duration;
    outbox_.clear();
    if (!is_tcp()) pty_.close();
    while (!clients_.empty()) drop(clients_.front().number);
  }
  if (!is_tcp() && !pty_.is_open() && now >= gone_until_)
    (void)open_pty(std::get<SerialEndpoint>(endpoint_));  // else tried again at the next tick
  for (auto& [number, unit] : units_) unit->tick();
  send_due();
}

void ModbusServer::hear(std::uint64_t number) {
  const auto client = std::find_if(clients_.begin(), clients_.end(),
                                   [&](const Client& one) { return one.number == number; });
  if (client == clients_.end()) return;
  std::array<std::uint8_t, 1024> buffer{};
  const ssize_t got = recv(client->descriptor, buffer.data(), buffer.size(), 0);
  if (got > 0 && client->deaf) return;
  if (got > 0) {
    client->pending.insert(client->pending.end(), buffer.begin(), buffer.begin() + got);
    if (answer_tcp(*client)) return;
  }
  drop(number);
}

void ModbusServer::accept_client() {
  const int accepted = accept4(listener_, nullptr, nullptr, SOCK_CLOEXEC);
  if (accepted < 0) return;
  if (clients_.size() >= most_clients || steady_clock::now() < gone_until_) {
    close(accepted);
    return;
  }
  const int on = 1;
  setsockopt(accepted, IPPROTO_TCP, TCP_NODELAY, &on, sizeof on);
  clients_.push_back({accepted, next_client_++, {}, false});
}

void ModbusServer::serve_tcp(const std::stop_token& stop) {
  while (!stop.stop_requested()) {
    std::vector<pollfd> watch{{listener_, POLLIN, 0}};
    std::vector<std::uint64_t> numbers;
    for (const Client& client : clients_) {
      watch.push_back({client.descriptor, POLLIN, 0});
      numbers.push_back(client.number);
    }
    const int ready = poll(watch.data(), watch.size(), poll_ms);
    tick();
    if (ready <= 0) continue;
    for (std::size_t i = 0; i < numbers.size(); ++i)
      if (watch[i + 1].revents != 0) hear(numbers[i]);
    if (watch[0].revents != 0) accept_client();
    send_due();
  }
}

void ModbusServer::answer_rtu(Bytes& pending) {
  for (;;) {
    const auto length = rtu_request_length(pending);
    if (!length) return;
    if (*length == 0) return;  // an unknown function: only silence tells where it ends
    if (pending.size() < *length) return;
    const Bytes request(pending.begin(), pending.begin() + static_cast<std::ptrdiff_t>(*length));
    const std::uint16_t crc = crc16(std::span(request).first(*length - 2));
    if (request[*length - 2] != (crc & 0xff) || request[*length - 1] != (crc >> 8)) {
      pending.clear();
      return;
    }
    pending.erase(pending.begin(), pending.begin() + static_cast<std::ptrdiff_t>(*length));
    serve(0, request[0], {request[0]}, std::span(request).subspan(1, *length - 3));
    send_due();
  }
}

// A frame that silence ended: a function we do not know is refused; what is no frame is forgotten.
void ModbusServer::end_frame(Bytes& pending) {
  const Bytes frame = std::exchange(pending, {});
  if (frame.size() < 4 || rtu_request_length(frame) != std::size_t{0}) return;
  const std::uint16_t crc = crc16(std::span(frame).first(frame.size() - 2));
  if (frame[frame.size() - 2] != (crc & 0xff) || frame[frame.size() - 1] != (crc >> 8)) return;
  serve(0, frame[0], {frame[0]}, std::span(frame).subspan(1, frame.size() - 3));
  send_due();
}

void ModbusServer::serve_rtu(const std::stop_token& stop) {
  Bytes pending;
  auto last_byte = steady_clock::now();
  while (!stop.stop_requested()) {
    pollfd watch{pty_.descriptor(), POLLIN, 0};
    const int ready = pty_.is_open() ? poll(&watch, 1, poll_ms) : 0;
    if (!pty_.is_open()) std::this_thread::sleep_for(std::chrono::milliseconds(poll_ms));
    tick();
    const auto now = steady_clock::now();
    if (!pending.empty() && now - last_byte > frame_silence) end_frame(pending);
    if (ready <= 0 || !pty_.is_open()) continue;
    std::array<std::uint8_t, 512> buffer{};
    const ssize_t got = read(pty_.descriptor(), buffer.data(), buffer.size());
    if (got <= 0) {
      std::this_thread::sleep_for(std::chrono::milliseconds(poll_ms));
      continue;
    }
    last_byte = now;
    pending.insert(pending.end(), buffer.begin(), buffer.begin() + got);
    answer_rtu(pending);
  }
}

}  // namespace lightrig::sim
