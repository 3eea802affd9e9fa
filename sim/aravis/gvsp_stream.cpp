#include "sim/aravis/gvsp_stream.h"

#include <arpa/inet.h>
#include <fmt/format.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <chrono>
#include <cstring>
#include <optional>
#include <thread>

namespace lightrig::sim {
namespace {

constexpr std::size_t frames_kept = 4;
constexpr int send_buffer_bytes = 4 << 20;
/// Shorter waits are not worth a sleep: the clock of the scheduler is coarser.
constexpr auto least_sleep = std::chrono::microseconds(200);

bool strikes(const std::vector<CameraFault>& struck, CameraFaultKind kind) {
  return std::ranges::any_of(struck, [&](const CameraFault& f) { return f.kind == kind; });
}

/// The order in which payload packets 1 … n leave.
std::vector<std::uint32_t> sending_order(std::uint32_t payloads,
                                         const std::vector<CameraFault>& struck) {
  std::vector<std::uint32_t> order;
  order.reserve(payloads);
  for (std::uint32_t packet = 1; packet <= payloads; ++packet) order.push_back(packet);
  if (strikes(struck, CameraFaultKind::packets_reordered))
    for (std::size_t i = 0; i + 1 < order.size(); i += 2) std::swap(order[i], order[i + 1]);
  if (strikes(struck, CameraFaultKind::packets_doubled)) {
    std::vector<std::uint32_t> doubled;
    for (const std::uint32_t packet : order) doubled.insert(doubled.end(), {packet, packet});
    return doubled;
  }
  return order;
}

/// Keeps packets apart as the link and the packet delay would.
class Pace {
 public:
  Pace(double link_rate, std::uint64_t packet_delay_ns)
      : link_rate_(link_rate), delay_(packet_delay_ns), due_(std::chrono::steady_clock::now()) {}

  void sent(std::size_t bytes) {
    using std::chrono::nanoseconds;
    if (link_rate_ > 0)
      due_ += nanoseconds(static_cast<std::int64_t>(1e9 * static_cast<double>(bytes) / link_rate_));
    due_ += nanoseconds(static_cast<std::int64_t>(delay_));
    if (due_ - std::chrono::steady_clock::now() > least_sleep) std::this_thread::sleep_until(due_);
  }

 private:
  double link_rate_;
  std::uint64_t delay_;
  std::chrono::steady_clock::time_point due_;
};

}  // namespace

Result<std::unique_ptr<GvspStream>> GvspStream::open(const std::string& address, double link_rate) {
  auto stream = std::unique_ptr<GvspStream>(new GvspStream);
  stream->link_rate_ = link_rate;
  stream->socket_ = socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
  sockaddr_in local{};
  local.sin_family = AF_INET;
  inet_pton(AF_INET, address.c_str(), &local.sin_addr);
  socklen_t size = sizeof local;
  if (stream->socket_ < 0 || bind(stream->socket_, reinterpret_cast<sockaddr*>(&local), size) != 0)
    return fail(ErrorCode::refused,
                fmt::format("open the stream channel at {}: {}", address, std::strerror(errno)));
  setsockopt(stream->socket_, SOL_SOCKET, SO_SNDBUF, &send_buffer_bytes, sizeof send_buffer_bytes);
  getsockname(stream->socket_, reinterpret_cast<sockaddr*>(&local), &size);
  stream->source_port_ = ntohs(local.sin_port);
  return stream;
}

GvspStream::~GvspStream() {
  if (socket_ >= 0) close(socket_);
}

void GvspStream::restart() {
  const std::lock_guard lock(mutex_);
  block_ = 0;
  history_.clear();
}

void GvspStream::transmit(const Packet& header, std::span<const std::uint8_t> body,
                          const StreamTarget& target) const {
  sockaddr_in to{};
  to.sin_family = AF_INET;
  to.sin_addr.s_addr = htonl(target.address);
  to.sin_port = htons(target.port);
  std::array<iovec, 2> parts{};
  parts[0] = {const_cast<std::uint8_t*>(header.data()), header.size()};
  parts[1] = {const_cast<std::uint8_t*>(body.data()), body.size()};
  msghdr message{};
  message.msg_name = &to;
  message.msg_namelen = sizeof to;
  message.msg_iov = parts.data();
  message.msg_iovlen = body.empty() ? 1 : 2;
  // What the network does not take is lost, as on any wire; the client asks again.
  static_cast<void>(sendmsg(socket_, &message, 0));
}

void GvspStream::send_packet(const Sent& sent, std::uint32_t packet, std::uint16_t status,
                             const StreamTarget& target) const {
  const WireFrame& frame = *sent.frame;
  if (packet == 0) return transmit(gvsp::leader(sent.block, frame.facts, status), {}, target);
  if (packet == sent.payloads + 1)
    return transmit(gvsp::trailer(sent.block, packet, frame.facts, status), {}, target);
  const std::size_t begin = (packet - 1) * sent.slice;
  const std::size_t length = std::min(sent.slice, frame.data.size() - begin);
  transmit(gvsp::payload_header(sent.block, packet, status),
           std::span(frame.data).subspan(begin, length), target);
}

GvspStream::Sent GvspStream::remember(WireFrame frame, const StreamTarget& target,
                                      const std::vector<CameraFault>& struck) {
  Sent sent;
  sent.slice = target.packet_size - gvsp::overhead_bytes;
  sent.payloads = static_cast<std::uint32_t>((frame.data.size() + sent.slice - 1) / sent.slice);
  sent.frame = std::make_shared<const WireFrame>(std::move(frame));
  const std::uint32_t middle = (sent.payloads + 1) / 2;
  if (strikes(struck, CameraFaultKind::packet_lost)) sent.withheld.insert(middle);
  if (strikes(struck, CameraFaultKind::packet_gone)) sent.gone.insert(middle);
  if (strikes(struck, CameraFaultKind::leader_gone)) sent.gone.insert(0);
  if (strikes(struck, CameraFaultKind::trailer_lost)) sent.withheld.insert(sent.payloads + 1);
  sent.withheld.insert(sent.gone.begin(), sent.gone.end());
  const std::lock_guard lock(mutex_);
  sent.block = block_ = block_ == 0xffff ? 1 : static_cast<std::uint16_t>(block_ + 1);
  history_.push_back(sent);
  if (history_.size() > frames_kept) history_.pop_front();
  return sent;
}

void GvspStream::send(WireFrame frame, const StreamTarget& target,
                      const std::vector<CameraFault>& struck, CameraWireFaults& faults,
                      const std::stop_token& stop) {
  if (target.port == 0) return;
  const Sent sent = remember(std::move(frame), target, struck);
  Pace pace(link_rate_, target.packet_delay);
  const auto arrives = [&](std::uint32_t packet) {
    return !sent.withheld.contains(packet) && !faults.loses_packet();
  };
  if (arrives(0)) send_packet(sent, 0, 0, target);
  for (const std::uint32_t packet : sending_order(sent.payloads, struck)) {
    if (stop.stop_requested()) return;
    if (arrives(packet)) send_packet(sent, packet, 0, target);
    pace.sent(target.packet_size);
  }
  if (arrives(sent.payloads + 1)) send_packet(sent, sent.payloads + 1, 0, target);
}

void GvspStream::resend(std::uint16_t block, std::uint32_t first, std::uint32_t last,
                        const StreamTarget& target, CameraWireFaults& faults) {
  if (target.port == 0) return;
  std::optional<Sent> known;
  {
    const std::lock_guard lock(mutex_);
    for (const Sent& sent : history_)
      if (sent.block == block) known = sent;
  }
  if (!known) return transmit(gvsp::payload_header(block, first, gvsp::unavailable), {}, target);
  for (std::uint32_t packet = first; packet <= std::min(last, known->payloads + 1); ++packet) {
    if (known->gone.contains(packet))
      transmit(gvsp::payload_header(block, packet, gvsp::unavailable), {}, target);
    else if (!faults.loses_packet())
      send_packet(*known, packet, gvsp::resent, target);
  }
}

void GvspStream::send_test_packet(const StreamTarget& target) {
  if (target.port == 0) return;
  const int discover = target.do_not_fragment ? IP_PMTUDISC_DO : IP_PMTUDISC_DONT;
  setsockopt(socket_, IPPROTO_IP, IP_MTU_DISCOVER, &discover, sizeof discover);
  const Packet filler(target.packet_size - gvsp::overhead_bytes, 0);
  transmit(gvsp::payload_header(0, 0, 0), filler, target);
}

}  // namespace lightrig::sim
