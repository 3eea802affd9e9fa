#pragma once

#include <map>
#include <memory>
#include <string>
#include <thread>
#include <variant>

#include "config/rig.h"
#include "core/result.h"
#include "sim/modbus/drive_registers.h"

namespace lightrig::sim {

/// The far end of one Modbus wire: the units on it, behind TCP or a pty, on a thread of its own.
/// Framing is ours rather than libmodbus', whose server answers for one RTU unit only and cannot
/// send what is wrong on purpose.
class ModbusServer {
 public:
  using Endpoint = std::variant<TcpEndpoint, SerialEndpoint>;
  using Units = std::map<int, std::unique_ptr<DriveRegisters>>;

  /// TCP: listens at the endpoint (port 0: any). Serial: opens a pty and, where the endpoint names
  /// a path that does not exist yet, links it there. Errors: refused (address in use), not_found.
  static Result<std::unique_ptr<ModbusServer>> open(const Endpoint& endpoint, Units units);
  ~ModbusServer();
  ModbusServer(const ModbusServer&) = delete;
  ModbusServer& operator=(const ModbusServer&) = delete;

  const std::string& address() const { return address_; }

 private:
  explicit ModbusServer(Units units) : units_(std::move(units)) {}
  Result<void> listen(const TcpEndpoint& endpoint);
  Result<void> open_pty(const SerialEndpoint& endpoint);
  void serve_tcp(const std::stop_token& stop);
  void serve_rtu(const std::stop_token& stop);
  bool answer_tcp(int client, std::vector<std::uint8_t>& pending);
  void answer_rtu(std::vector<std::uint8_t>& pending);

  Units units_;
  std::string address_;
  std::string link_;     // to be removed
  int listener_ = -1;    // TCP
  int master_ = -1;      // pty
  int slave_ = -1;       // held open: a pty whose slave nobody holds hangs up
  std::jthread thread_;  // last
};

}  // namespace lightrig::sim
