#include "sim/aravis/gv_camera.h"

#include <arpa/inet.h>
#include <fmt/format.h>
#include <netinet/in.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <cstring>

namespace lightrig::sim {
namespace {

using std::chrono::steady_clock;

constexpr int poll_ms = 20;
constexpr double boot_seconds = 0.5;
constexpr std::uint32_t control_bits = 0x3;  // exclusive, control
constexpr std::uint32_t latch_timestamp = 2;
constexpr std::uint32_t fire_test_packet = 1U << 31, do_not_fragment = 1U << 30;

steady_clock::duration seconds_of(double seconds) {
  return std::chrono::duration_cast<steady_clock::duration>(std::chrono::duration<double>(seconds));
}

/// A UDP socket at an address; the reason in errno when there is none.
int bound_socket(std::uint32_t address, bool shared) {
  const int socket = ::socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
  const int on = 1;
  if (shared) {
    setsockopt(socket, SOL_SOCKET, SO_REUSEADDR, &on, sizeof on);
    setsockopt(socket, SOL_SOCKET, SO_BROADCAST, &on, sizeof on);
  }
  sockaddr_in local{};
  local.sin_family = AF_INET;
  local.sin_port = htons(gvcp::port);
  local.sin_addr.s_addr = address;
  if (bind(socket, reinterpret_cast<sockaddr*>(&local), sizeof local) == 0) return socket;
  const int reason = errno;
  close(socket);
  errno = reason;
  return -1;
}

}  // namespace

Result<std::unique_ptr<GvCamera>> GvCamera::open(const CameraBody& body, Sensor sensor,
                                                 Clock& clock,
                                                 std::shared_ptr<CameraWireFaults> faults) {
  if (!faults) faults = std::make_shared<CameraWireFaults>();
  auto camera = std::unique_ptr<GvCamera>(new GvCamera(body, std::move(faults)));
  if (auto bound = camera->bind_sockets(); !bound) return tl::unexpected(bound.error());
  auto stream = GvspStream::open(body.address, body.link_rate);
  if (!stream) return tl::unexpected(stream.error());
  camera->stream_ = std::move(*stream);
  GvCamera* raw = camera.get();
  camera->registers_.set_word(reg_stream_source_port, raw->stream_->source_port());
  camera->acquisition_ = std::make_unique<Acquisition>(
      body, std::move(sensor), clock, *raw->stream_, *raw->faults_,
      Acquisition::Owner{[raw] { return raw->next_shot(); },
                         [raw](const CameraFault& fault) { raw->befall(fault); }});
  camera->thread_ = std::jthread([raw](const std::stop_token& stop) { raw->serve(stop); });
  return camera;
}

GvCamera::GvCamera(const CameraBody& body, std::shared_ptr<CameraWireFaults> faults)
    : body_(body),
      faults_(std::move(faults)),
      registers_(body),
      heard_(steady_clock::now()),
      deaf_until_(heard_),
      stolen_until_(heard_),
      booted_(heard_) {}

GvCamera::~GvCamera() {
  if (thread_.joinable()) {
    thread_.request_stop();
    thread_.join();
  }
  acquisition_.reset();
  for (int descriptor : {control_, broadcast_})
    if (descriptor >= 0) close(descriptor);
}

Result<void> GvCamera::bind_sockets() {
  in_addr address{};
  if (inet_pton(AF_INET, body_.address.c_str(), &address) != 1)
    return fail(ErrorCode::invalid_input,
                fmt::format("host a camera at \"{}\": give an IPv4 address of this machine",
                            body_.address));
  control_ = bound_socket(address.s_addr, false);
  if (control_ < 0)
    return fail(ErrorCode::refused,
                fmt::format("host a camera at {}:{}: {}; the address must be this machine's own "
                            "(every 127.x.y.z is; `ip address add` gives it another) and no other "
                            "camera may answer there",
                            body_.address, gvcp::port, std::strerror(errno)));
  broadcast_ = bound_socket(INADDR_BROADCAST, true);  // discovery goes to everybody
  if (broadcast_ < 0)
    return fail(ErrorCode::refused, fmt::format("listen for camera discovery on port {}: {}",
                                                gvcp::port, std::strerror(errno)));
  return {};
}

// --- the control channel

void GvCamera::serve(const std::stop_token& stop) {
  while (!stop.stop_requested()) {
    std::array<pollfd, 2> watch{{{control_, POLLIN, 0}, {broadcast_, POLLIN, 0}}};
    const int ready = poll(watch.data(), watch.size(), poll_ms);
    {
      const std::lock_guard lock(mutex_);
      drop_dead_controller();
    }
    if (ready <= 0) continue;
    for (const pollfd& one : watch)
      if ((one.revents & POLLIN) != 0) receive(one.fd);
  }
}

void GvCamera::receive(int socket) {
  std::array<std::uint8_t, 2048> buffer{};
  sockaddr_in from{};
  socklen_t size = sizeof from;
  const ssize_t got =
      recvfrom(socket, buffer.data(), buffer.size(), 0, reinterpret_cast<sockaddr*>(&from), &size);
  if (got <= 0) return;
  const auto command = gvcp::read_command(std::span(buffer).first(static_cast<std::size_t>(got)));
  if (!command) return;
  const std::lock_guard lock(mutex_);
  if (steady_clock::now() < deaf_until_) return;
  const auto said = answer(*command, {ntohl(from.sin_addr.s_addr), ntohs(from.sin_port)});
  if (!said || !command->wants_answer) return;
  // Always from the camera's own address, even when asked by broadcast.
  static_cast<void>(
      sendto(control_, said->data(), said->size(), 0, reinterpret_cast<sockaddr*>(&from), size));
}

std::optional<Packet> GvCamera::answer(const gvcp::Command& command, const Peer& from) {
  if (controller_ == from) heard_ = steady_clock::now();
  switch (command.code) {
    case gvcp::discovery:
      return gvcp::answer(command, GvStatus::ok, registers_.discovery());
    case gvcp::packet_resend:
      // Asked for from the client's stream port, not from its control port.
      if (command.data.size() >= 12 && controller_ && controller_->address == from.address &&
          faults_->resends())
        stream_->resend(static_cast<std::uint16_t>(word_at(command.data, 0)),
                        word_at(command.data, 4) & 0xffffff, word_at(command.data, 8) & 0xffffff,
                        target(), *faults_);
      return std::nullopt;
    case gvcp::read_register:
      return answer_read_registers(command);
    case gvcp::write_register:
      return answer_write_registers(command, from);
    case gvcp::read_memory:
      return answer_read_memory(command);
    case gvcp::write_memory:
      return answer_write_memory(command, from);
    default:
      return gvcp::answer(command, GvStatus::not_implemented, {});
  }
}

Packet GvCamera::answer_read_registers(const gvcp::Command& command) const {
  if (command.data.empty() || command.data.size() % 4 != 0)
    return gvcp::answer(command, GvStatus::invalid_parameter, {});
  Packet values(command.data.size());
  for (std::size_t i = 0; i < command.data.size(); i += 4) {
    const GvStatus status =
        registers_.read(word_at(command.data, i), std::span(values).subspan(i, 4));
    if (status != GvStatus::ok) return gvcp::answer(command, status, {});
  }
  return gvcp::answer(command, GvStatus::ok, values);
}

Packet GvCamera::answer_write_registers(const gvcp::Command& command, const Peer& from) {
  if (command.data.empty() || command.data.size() % 8 != 0)
    return gvcp::answer(command, GvStatus::invalid_parameter, {});
  for (std::size_t i = 0; i < command.data.size(); i += 8) {
    const GvStatus status = write(word_at(command.data, i), command.data.subspan(i + 4, 4), from);
    if (status != GvStatus::ok) return gvcp::answer(command, status, {});
  }
  Packet written;
  append32(written, static_cast<std::uint32_t>(command.data.size() / 8));
  return gvcp::answer(command, GvStatus::ok, written);
}

Packet GvCamera::answer_read_memory(const gvcp::Command& command) const {
  if (command.data.size() != 8) return gvcp::answer(command, GvStatus::invalid_parameter, {});
  const std::size_t count = word_at(command.data, 4) & 0xffff;
  if (count == 0 || count > gvcp::most_memory_bytes)
    return gvcp::answer(command, GvStatus::invalid_parameter, {});
  Packet data(4 + count);
  std::copy_n(command.data.begin(), 4, data.begin());
  const GvStatus status = registers_.read(word_at(command.data, 0), std::span(data).subspan(4));
  return gvcp::answer(command, status, data);
}

Packet GvCamera::answer_write_memory(const gvcp::Command& command, const Peer& from) {
  if (command.data.size() < 8) return gvcp::answer(command, GvStatus::invalid_parameter, {});
  const GvStatus status = write(word_at(command.data, 0), command.data.subspan(4), from);
  Packet written;
  append32(written, static_cast<std::uint32_t>(command.data.size() - 4));
  return gvcp::answer(command, status, written);
}

GvStatus GvCamera::write(std::uint32_t address, std::span<const std::uint8_t> bytes,
                         const Peer& from) {
  if (address == reg_privilege && bytes.size() == 4)
    return write_privilege(word_at(bytes, 0), from);
  if (controller_ != from) return GvStatus::access_denied;
  const std::uint32_t value = bytes.size() >= 4 ? word_at(bytes, 0) : 0;
  const bool held = address == reg_gamma_enable && registers_.word(address) == 1;
  if (held && faults_->holds_gamma()) return GvStatus::ok;
  const GvStatus status = registers_.write(address, bytes);
  if (status == GvStatus::ok) act_on(address, value);
  return status;
}

GvStatus GvCamera::write_privilege(std::uint32_t value, const Peer& from) {
  const bool in_other_hands = controller_ && controller_ != from;
  if (in_other_hands || steady_clock::now() < stolen_until_) return GvStatus::access_denied;
  if ((value & control_bits) == 0) {
    if (controller_) release_control();
    return GvStatus::ok;
  }
  controller_ = from;
  heard_ = steady_clock::now();
  registers_.set_word(reg_privilege, value & control_bits);
  return GvStatus::ok;
}

/// Nobody controls it any more: nothing is sent to anybody.
void GvCamera::release_control() {
  controller_.reset();
  registers_.set_word(reg_privilege, 0);
  registers_.set_word(reg_stream_port, 0);
  acquisition_->stop();
}

void GvCamera::drop_dead_controller() {
  const auto now = steady_clock::now();
  if (stolen_until_ > booted_ && now >= stolen_until_) {  // the thief has gone
    stolen_until_ = booted_;
    registers_.set_word(reg_privilege, 0);
  }
  const std::chrono::milliseconds patience(registers_.word(reg_heartbeat));
  if (controller_ && now - heard_ > patience) release_control();
}

void GvCamera::act_on(std::uint32_t address, std::uint32_t value) {
  switch (address) {
    case reg_acquisition_start:
      if (faults_->numbers_anew()) stream_->restart();
      return acquisition_->start();
    case reg_acquisition_stop:
      return acquisition_->stop();
    case reg_trigger_software:
      if (registers_.settings().software_trigger) acquisition_->trigger();
      return;
    case reg_stream_port:
      stream_->restart();  // block numbers begin with the channel
      return;
    case reg_packet_size:
      if ((value & fire_test_packet) != 0) stream_->send_test_packet(target());
      return;
    case reg_timestamp_control:
      if ((value & latch_timestamp) != 0) {
        const std::uint64_t now = timestamp();
        registers_.set_word(reg_timestamp_high, static_cast<std::uint32_t>(now >> 32));
        registers_.set_word(reg_timestamp_low, static_cast<std::uint32_t>(now));
      }
      return;
    case reg_user_set_load:
      if (!faults_->keeps_settings()) registers_.load_default_user_set();
      return;
    case reg_device_reset:
      return reboot(boot_seconds);
    default:
      return;
  }
}

// --- what the acquisition asks and tells

StreamTarget GvCamera::target() const {
  StreamTarget target;
  target.address = registers_.word(reg_stream_destination);
  target.port = static_cast<std::uint16_t>(registers_.word(reg_stream_port) & 0xffff);
  target.packet_size = registers_.word(reg_packet_size) & 0xffff;
  target.packet_delay = registers_.word(reg_packet_delay);
  target.do_not_fragment = (registers_.word(reg_packet_size) & do_not_fragment) != 0;
  return target;
}

std::uint64_t GvCamera::timestamp() const {
  using std::chrono::nanoseconds;
  return static_cast<std::uint64_t>(
      std::chrono::duration_cast<nanoseconds>(steady_clock::now() - booted_).count());
}

Shot GvCamera::next_shot() {
  const std::lock_guard lock(mutex_);
  Shot shot{registers_.settings(), target(), timestamp()};
  if (steady_clock::now() < deaf_until_) shot.target.port = 0;  // frozen: it sends nothing
  return shot;
}

void GvCamera::befall(const CameraFault& fault) {
  const std::lock_guard lock(mutex_);
  switch (fault.kind) {
    case CameraFaultKind::frozen:
      deaf_until_ = steady_clock::now() + seconds_of(fault.seconds);
      return;
    case CameraFaultKind::rebooted:
      return reboot(fault.seconds);
    case CameraFaultKind::privilege_stolen:
      release_control();
      stolen_until_ = steady_clock::now() + seconds_of(fault.seconds);
      registers_.set_word(reg_privilege, 2);
      return;
    default:
      return;
  }
}

/// Everything is as it was when the camera was switched on; it answers after a while.
void GvCamera::reboot(double deaf_seconds) {
  acquisition_->stop();
  stream_->restart();
  controller_.reset();
  registers_ = CameraRegisters(body_);
  registers_.set_word(reg_stream_source_port, stream_->source_port());
  booted_ = steady_clock::now();
  stolen_until_ = booted_;
  deaf_until_ = booted_ + seconds_of(deaf_seconds);
}

}  // namespace lightrig::sim
