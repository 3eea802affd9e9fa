#pragma once

#include <cstdint>
#include <deque>
#include <map>
#include <memory>
#include <string>
#include <thread>
#include <variant>
#include <vector>

#include "config/rig.h"
#include "core/result.h"
#include "drivers/clock.h"
#include "sim/modbus/modbus_pdu.h"
#include "sim/modbus/modbus_unit.h"
#include "sim/pty.h"
#include "sim/wire_faults.h"

namespace lightrig::sim {

/// The far end of one Modbus wire: the units on it, behind TCP or a pty, on a thread of its own.
/// Framing is ours rather than libmodbus', whose server answers for one RTU unit only and cannot
/// send what is wrong on purpose.
class ModbusServer {
 public:
  using Endpoint = std::variant<TcpEndpoint, SerialEndpoint>;
  using Units = std::map<int, std::unique_ptr<ModbusUnit>>;

  /// TCP: listens at the endpoint (port 0: any). Serial: opens a pty and, where the endpoint names
  /// a path that does not exist yet, links it there. `faults` may be null; `wire` is whose they
  /// are. Errors: refused (address in use), not_found.
  static Result<std::unique_ptr<ModbusServer>> open(const Endpoint& endpoint, Units units,
                                                    std::shared_ptr<WireFaults> faults, Wire wire);
  ~ModbusServer();
  ModbusServer(const ModbusServer&) = delete;
  ModbusServer& operator=(const ModbusServer&) = delete;

  const std::string& address() const { return address_; }

 private:
  struct Client {
    int descriptor = -1;
    std::uint64_t number = 0;
    Bytes pending;
    bool deaf = false;  ///< half open: nothing more is read
  };
  /// An answer on its way, perhaps late. `client` 0 is the pty.
  struct Outgoing {
    std::chrono::steady_clock::time_point time;
    std::uint64_t client = 0;
    Bytes bytes;
  };

  ModbusServer(Endpoint endpoint, Units units, std::shared_ptr<WireFaults> faults, Wire wire)
      : endpoint_(std::move(endpoint)),
        units_(std::move(units)),
        faults_(std::move(faults)),
        wire_(wire) {}
  Result<void> listen(const TcpEndpoint& endpoint);
  Result<void> open_pty(const SerialEndpoint& endpoint);
  void serve_tcp(const std::stop_token& stop);
  void serve_rtu(const std::stop_token& stop);
  void hear(std::uint64_t number);
  void accept_client();
  bool answer_tcp(Client& client);
  void answer_rtu(Bytes& pending);
  void end_frame(Bytes& pending);
  bool serve(std::uint64_t client, std::uint8_t unit, const Bytes& head,
             std::span<const std::uint8_t> pdu);
  Bytes framed(const Bytes& head, const Bytes& pdu) const;
  void send_due();
  void transmit(const Outgoing& outgoing);
  void tick();
  void drop(std::uint64_t client);
  bool is_tcp() const { return std::holds_alternative<TcpEndpoint>(endpoint_); }

  const Endpoint endpoint_;
  Units units_;
  std::shared_ptr<WireFaults> faults_;
  const Wire wire_;
  std::string address_;
  int listener_ = -1;  // TCP
  Pty pty_;
  // Below: the thread's own.
  std::vector<Client> clients_;
  std::uint64_t next_client_ = 1;
  std::deque<Outgoing> outbox_;
  std::chrono::steady_clock::time_point silent_until_{}, gone_until_{}, last_answer_{};
  std::jthread thread_;  // last
};

}  // namespace lightrig::sim
