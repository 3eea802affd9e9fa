#pragma once

#include <chrono>
#include <cstdint>
#include <map>
#include <memory>
#include <stop_token>
#include <string>
#include <variant>
#include <vector>

#include "config/controller_profile.h"
#include "config/rig.h"
#include "drivers/blocking_lane.h"
#include "drivers/clock.h"

struct _modbus;

namespace lightrig {

/// What has to come before a write.
enum class Delivery : std::uint8_t {
  in_step,     ///< the wire is proved to be in step: nothing is written blindly
  sent_first,  ///< of what can do no harm and may not wait (a lamp's 0): at once if the wire is out
               ///< of step, and again once it is in step, for an answer that can be believed
  sent_only,   ///< the same at once and no more: a stop. Whatever answers is not believed
};

/// One Modbus wire, TCP or RTU, shared by the drives on it. Every call is one transaction, one
/// attempt, on the bus' own lane: the caller leaves at its deadline or within 10 ms of a stop.
///
/// An RTU reply carries no transaction number, so a late one would pass as the answer to the next
/// request. After a timeout the bus therefore stays silent past the worst reply time, flushes, and
/// proves itself in step by two reads of different lengths from the unit that is asked next before
/// it believes anything: a unit that is dead keeps nobody from the others. A TCP wire
/// is closed and connected anew after any error but a plain exception.
class ModbusBus {
 public:
  using Endpoint = std::variant<TcpEndpoint, SerialEndpoint>;

  /// Connects. `gap` is the silence that the units want between an answer and the next request,
  /// where that is more than Modbus asks. Errors: not_found (no host, no device), refused (port
  /// closed, device in use), timed_out.
  static Result<std::unique_ptr<ModbusBus>> open(const Endpoint& endpoint,
                                                 std::chrono::milliseconds timeout,
                                                 std::chrono::milliseconds gap, Clock& clock);
  ~ModbusBus();
  ModbusBus(const ModbusBus&) = delete;
  ModbusBus& operator=(const ModbusBus&) = delete;

  /// Register or bit values (a bit as 0 or 1). Errors: refused (exception, with its name),
  /// timed_out, disconnected, stopped.
  Result<std::vector<std::uint16_t>> read(int unit, RegisterTable table, int address, int count,
                                          const Until& until);
  /// Writes one value by FC05/FC06, or several by FC15/FC16; `multiple` forces the latter for one
  /// value.
  Result<void> write(int unit, RegisterTable table, int address,
                     const std::vector<std::uint16_t>& values, bool multiple, const Until& until,
                     Delivery delivery = Delivery::in_step);

  /// A register to read.
  struct Place {
    int unit = 0;
    RegisterTable table = RegisterTable::holding;
    int address = 0;
    int count = 1;
  };
  /// Reads these whenever nothing was asked for so long, so that the drives' own watchdogs bark
  /// only when this program is gone or the wire is. Set once, before anything is asked.
  void keep_alive(std::vector<Place> places, std::chrono::milliseconds every);

  const std::string& name() const { return name_; }
  /// How long a last word may take (a stop, a lamp's 0): the call in progress ends within its
  /// timeout, then the word goes out and is answered.
  std::chrono::milliseconds farewell() const;

 private:
  using Values = std::vector<std::uint16_t>;
  struct FreeContext {
    void operator()(_modbus* context) const;
  };

  ModbusBus(Endpoint endpoint, std::chrono::milliseconds timeout, std::chrono::milliseconds gap,
            Clock& clock);
  Result<void> connect();
  void set_patience(std::chrono::milliseconds patience);
  Result<void> ready(int unit, const std::stop_token& stop);
  void clear_line();
  Result<void> prove_in_step(int unit, const std::stop_token& stop);
  Result<Values> read_now(int unit, RegisterTable table, int address, int count);
  Result<Values> write_now(int unit, RegisterTable table, int address, const Values& values,
                           bool multiple);
  Result<Values> send(int unit, RegisterTable table, int address, const Values& values,
                      bool multiple);
  tl::unexpected<Error> failed(const std::string& doing, int number);

  const Endpoint endpoint_;
  const std::chrono::milliseconds timeout_;
  Clock& clock_;
  std::string name_;
  bool rtu_ = false;
  const std::chrono::microseconds silence_;  ///< between an answer and the next request
  // Below: touched on the lane only.
  std::unique_ptr<_modbus, FreeContext> context_;
  bool connected_ = false;
  bool out_of_step_ = false;
  std::chrono::steady_clock::time_point last_heard_{};
  std::map<int, Place> proofs_;  ///< of each unit, what was read with success and is two long
  BlockingLane<Values> lane_;    // destroyed first
};

}  // namespace lightrig
