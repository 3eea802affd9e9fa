#include "drivers/modbus/modbus_bus.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <modbus/modbus.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <sys/file.h>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <limits>
#include <thread>

namespace lightrig {
namespace {

/// An RTU unit that answers later than this many timeouts is broken beyond what a bus can repair.
constexpr int silence_in_timeouts = 3;
constexpr int proofs_before_giving_up = 3;
/// For the answer to what is sent at any rate: the next unit waits for its own.
constexpr std::chrono::milliseconds short_patience{150};

std::string name_of(const ModbusBus::Endpoint& endpoint) {
  if (const auto* tcp = std::get_if<TcpEndpoint>(&endpoint))
    return fmt::format("modbus tcp {}:{}", tcp->host, tcp->port);
  return "modbus rtu " + std::get<SerialEndpoint>(endpoint).device;
}

bool is_bits(RegisterTable table) {
  return table == RegisterTable::coil || table == RegisterTable::discrete;
}

const char* name_of(RegisterTable table) {
  switch (table) {
    case RegisterTable::coil:
      return "coil";
    case RegisterTable::discrete:
      return "discrete input";
    case RegisterTable::holding:
      return "holding register";
    case RegisterTable::input:
      return "input register";
  }
  return "?";
}

/// Silence that ends a frame: 3.5 characters of 11 bits, and at least 1.75 ms [MODBUS over serial
/// line 1.02, 2.5.1.1].
std::chrono::microseconds silence_between_frames(const ModbusBus::Endpoint& endpoint) {
  const auto* serial = std::get_if<SerialEndpoint>(&endpoint);
  if (!serial || serial->baud <= 0) return std::chrono::microseconds(0);
  return std::max(std::chrono::microseconds(1750),
                  std::chrono::microseconds(3500LL * 11 * 1000 / serial->baud));
}

bool is_exception(int number) { return number > MODBUS_ENOBASE && number < EMBBADCRC; }

/// Exceptions that say "not now" [Modbus Application Protocol 1.1b3, 7]; the others say that the
/// request is wrong, and will say so again.
bool may_pass(int number) {
  return number == EMBXSFAIL || number == EMBXACK || number == EMBXSBUSY || number == EMBXGPATH ||
         number == EMBXGTAR;
}

ErrorCode code_of(int number) {
  if (is_exception(number)) return may_pass(number) ? ErrorCode::timed_out : ErrorCode::refused;
  switch (number) {
    case ETIMEDOUT:
    case EINPROGRESS:  // a connect that nobody answers
    case EMBBADCRC:
    case EMBBADDATA:
    case EMBBADEXC:
    case EMBUNKEXC:
    case EMBMDATA:
    case EMBBADSLAVE:
      return ErrorCode::timed_out;
    case ENOENT:
    case ENXIO:
    case EHOSTUNREACH:
    case ENETUNREACH:
      return ErrorCode::not_found;
    case ECONNREFUSED:
    case EACCES:
    case EPERM:
    case EBUSY:
      return ErrorCode::refused;
    default:
      return ErrorCode::disconnected;
  }
}

/// Without it a half-open connection (power cut at the far end) would swallow writes for many
/// minutes.
void bound_unacknowledged_time(int socket, std::chrono::milliseconds timeout) {
  const auto limit = static_cast<unsigned>(2 * timeout.count());
  setsockopt(socket, IPPROTO_TCP, TCP_USER_TIMEOUT, &limit, sizeof limit);
  const int on = 1;
  setsockopt(socket, IPPROTO_TCP, TCP_NODELAY, &on, sizeof on);
}

_modbus* new_context(const ModbusBus::Endpoint& endpoint) {
  if (const auto* tcp = std::get_if<TcpEndpoint>(&endpoint))
    return modbus_new_tcp_pi(tcp->host.c_str(), std::to_string(tcp->port).c_str());
  const auto& serial = std::get<SerialEndpoint>(endpoint);
  return modbus_new_rtu(serial.device.c_str(), serial.baud, serial.parity, serial.data_bits,
                        serial.stop_bits);
}

}  // namespace

void ModbusBus::FreeContext::operator()(_modbus* context) const {
  modbus_close(context);
  modbus_free(context);
}

ModbusBus::ModbusBus(Endpoint endpoint, std::chrono::milliseconds timeout,
                     std::chrono::milliseconds gap, Clock& clock)
    : endpoint_(std::move(endpoint)),
      timeout_(timeout),
      clock_(clock),
      name_(name_of(endpoint_)),
      rtu_(std::holds_alternative<SerialEndpoint>(endpoint_)),
      silence_(std::max<std::chrono::microseconds>(silence_between_frames(endpoint_), gap)),
      lane_(name_) {}

ModbusBus::~ModbusBus() = default;

Result<std::unique_ptr<ModbusBus>> ModbusBus::open(const Endpoint& endpoint,
                                                   std::chrono::milliseconds timeout,
                                                   std::chrono::milliseconds gap, Clock& clock) {
  auto bus = std::unique_ptr<ModbusBus>(new ModbusBus(endpoint, timeout, gap, clock));
  const Until until{clock.now() + 4 * timeout + std::chrono::seconds(1), {}};
  auto connected = bus->lane_.run(
      [raw = bus.get()](const std::stop_token&) -> Result<Values> {
        if (auto done = raw->connect(); !done) return tl::unexpected(done.error());
        return Values{};
      },
      clock, until);
  if (!connected) return tl::unexpected(connected.error());
  return bus;
}

tl::unexpected<Error> ModbusBus::failed(const std::string& doing, int number) {
  const ErrorCode code = code_of(number);
  if (!is_exception(number)) {
    if (rtu_) {
      out_of_step_ = true;
      if (code == ErrorCode::disconnected) connected_ = false;
    } else {
      modbus_close(context_.get());
      connected_ = false;
    }
  }
  return fail(code, fmt::format("{}: {}: {}", name_, doing, modbus_strerror(number)));
}

Result<void> ModbusBus::connect() {
  context_.reset(new_context(endpoint_));
  if (!context_)
    return fail(ErrorCode::invalid_input, name_ + ": unusable address or serial settings");
  set_patience(timeout_);
  modbus_set_error_recovery(context_.get(), MODBUS_ERROR_RECOVERY_NONE);
  if (modbus_connect(context_.get()) != 0) {
    auto failure = failed("connect", errno);
    failure.value().message += rtu_ ? "; check the cable, the device name and the group dialout"
                                    : "; check power, network, address and port of the controller";
    return failure;
  }
  const int descriptor = modbus_get_socket(context_.get());
  if (rtu_) {
    if (flock(descriptor, LOCK_EX | LOCK_NB) != 0)
      return fail(ErrorCode::refused, name_ + " is in use by another program");
    const auto& serial = std::get<SerialEndpoint>(endpoint_);
    if (serial.rs485 && modbus_rtu_set_serial_mode(context_.get(), MODBUS_RTU_RS485) != 0)
      return failed("switch the port to RS-485", errno);
  } else {
    bound_unacknowledged_time(descriptor, timeout_);
  }
  connected_ = true;
  return {};
}

std::chrono::milliseconds ModbusBus::farewell() const {
  return std::max(std::chrono::milliseconds(1000), 2 * timeout_ + std::chrono::milliseconds(500));
}

void ModbusBus::set_patience(std::chrono::milliseconds patience) {
  const auto whole = std::chrono::duration_cast<std::chrono::seconds>(patience);
  const auto rest = std::chrono::duration_cast<std::chrono::microseconds>(patience - whole);
  modbus_set_response_timeout(context_.get(), static_cast<std::uint32_t>(whole.count()),
                              static_cast<std::uint32_t>(rest.count()));
}

Result<void> ModbusBus::ready(int unit, const std::stop_token& stop) {
  if (!connected_)
    if (auto done = connect(); !done) return done;
  if (out_of_step_)
    if (auto proved = prove_in_step(unit, stop); !proved) return proved;
  clear_line();
  if (modbus_set_slave(context_.get(), unit) != 0)
    return fail(ErrorCode::invalid_input, fmt::format("{}: unit {} does not exist", name_, unit));
  return {};
}

// What is sent unasked for (an answer twice) must not be taken for the next answer. It begins
// within the silence that has to lie between frames anyway; what has begun is heard to its end.
void ModbusBus::clear_line() {
  std::this_thread::sleep_until(last_heard_ + silence_);
  if (!rtu_) return;
  const auto patience = std::chrono::steady_clock::now() + timeout_;
  int waiting = 0;
  while (ioctl(modbus_get_socket(context_.get()), FIONREAD, &waiting) == 0 && waiting > 0 &&
         std::chrono::steady_clock::now() < patience) {
    modbus_flush(context_.get());
    std::this_thread::sleep_for(silence_);
  }
}

// Silence first, so that whatever was late has come; then two reads whose answers differ in length.
// A reply from before, taken for the first answer, leaves the first answer to be taken for the
// second, and its length gives it away.
Result<void> ModbusBus::prove_in_step(int unit, const std::stop_token& stop) {
  for (int attempt = 0; attempt < proofs_before_giving_up; ++attempt) {
    out_of_step_ = true;  // an exception is no proof either
    const auto silent = std::chrono::steady_clock::now() + silence_in_timeouts * timeout_;
    while (std::chrono::steady_clock::now() < silent) {
      if (stop.stop_requested()) return fail(ErrorCode::stopped, name_ + ": stopped on request");
      std::this_thread::sleep_for(std::chrono::milliseconds(5));
    }
    modbus_flush(context_.get());
    out_of_step_ = false;
    const auto known = proofs_.find(unit);
    if (known == proofs_.end()) return {};  // nothing to read: silence and an empty line must do
    const Place& proof = known->second;
    if (modbus_set_slave(context_.get(), unit) != 0) break;
    if (!read_now(unit, proof.table, proof.address, 1)) continue;
    std::this_thread::sleep_for(silence_);  // and no flush: what lies there is what is to be found
    if (read_now(unit, proof.table, proof.address, 2)) return {};
  }
  out_of_step_ = true;
  return fail(
      ErrorCode::disconnected,
      fmt::format("{}: answers of unit {} do not match requests any more; check its power, wiring, "
                  "termination and that no second master is on the bus",
                  name_, unit));
}

Result<ModbusBus::Values> ModbusBus::read_now(int unit, RegisterTable table, int address,
                                              int count) {
  Values values(static_cast<std::size_t>(count));
  std::vector<std::uint8_t> bits(static_cast<std::size_t>(count));
  int got = -1;
  switch (table) {
    case RegisterTable::coil:
      got = modbus_read_bits(context_.get(), address, count, bits.data());
      break;
    case RegisterTable::discrete:
      got = modbus_read_input_bits(context_.get(), address, count, bits.data());
      break;
    case RegisterTable::holding:
      got = modbus_read_registers(context_.get(), address, count, values.data());
      break;
    case RegisterTable::input:
      got = modbus_read_input_registers(context_.get(), address, count, values.data());
      break;
  }
  last_heard_ = std::chrono::steady_clock::now();
  if (got != count)
    return failed(fmt::format("read {} {:#06x} of unit {}", name_of(table), address, unit), errno);
  if (is_bits(table)) values.assign(bits.begin(), bits.end());
  return values;
}

Result<ModbusBus::Values> ModbusBus::write_now(int unit, RegisterTable table, int address,
                                               const Values& values, bool multiple) {
  const int count = static_cast<int>(values.size());
  int done = -1;
  if (table == RegisterTable::coil && count == 1 && !multiple) {
    done = modbus_write_bit(context_.get(), address, values[0] != 0 ? 1 : 0);
  } else if (table == RegisterTable::coil) {
    std::vector<std::uint8_t> bits(values.begin(), values.end());
    done = modbus_write_bits(context_.get(), address, count, bits.data());
  } else if (table == RegisterTable::holding && count == 1 && !multiple) {
    done = modbus_write_register(context_.get(), address, values[0]);
  } else if (table == RegisterTable::holding) {
    done = modbus_write_registers(context_.get(), address, count, values.data());
  } else {
    return fail(ErrorCode::invalid_input, fmt::format("a {} cannot be written", name_of(table)));
  }
  last_heard_ = std::chrono::steady_clock::now();
  if (done != count)
    return failed(fmt::format("write {} {:#06x} of unit {}", name_of(table), address, unit), errno);
  return Values{};
}

// A failure to hear is no failure to be heard.
Result<ModbusBus::Values> ModbusBus::send(int unit, RegisterTable table, int address,
                                          const Values& values, bool multiple) {
  if (!connected_)
    if (auto done = connect(); !done) return tl::unexpected(done.error());
  const bool doubtful = out_of_step_;
  clear_line();
  if (modbus_set_slave(context_.get(), unit) != 0)
    return fail(ErrorCode::invalid_input, fmt::format("{}: unit {} does not exist", name_, unit));
  set_patience(std::min(timeout_, short_patience));
  Result<Values> done = write_now(unit, table, address, values, multiple);
  if (context_ && connected_) set_patience(timeout_);
  out_of_step_ = out_of_step_ || doubtful;
  return done;
}

void ModbusBus::keep_alive(std::vector<Place> places, std::chrono::milliseconds every) {
  lane_.when_idle(every, [this, places = std::move(places)](const std::stop_token& stop) {
    // A wire that broke or fell out of step is mended meanwhile: connecting and proving only read.
    // A dead unit is given up as a call would give it up, and the others are fed; where that takes
    // longer than their watchdogs' time, those end in what is safe.
    const auto feed = [&](const Place& place) {
      return ready(place.unit, stop).and_then([&]() -> Result<void> {
        auto read = read_now(place.unit, place.table, place.address, place.count);
        return read ? Result<void>() : tl::unexpected(read.error());
      });
    };
    std::vector<Place> hungry;
    for (const Place& place : places) {
      if (stop.stop_requested()) return;
      if (!feed(place)) hungry.push_back(place);
    }
    // Once more at once: a request that was lost must not cost another wait.
    for (const Place& place : hungry)
      if (!stop.stop_requested()) (void)feed(place);
  });
}

Result<ModbusBus::Values> ModbusBus::read(int unit, RegisterTable table, int address, int count,
                                          const Until& until) {
  return lane_.run(
      [=, this](const std::stop_token& stop) -> Result<Values> {
        if (auto up = ready(unit, stop); !up) return tl::unexpected(up.error());
        if (stop.stop_requested()) return fail(ErrorCode::stopped, name_ + ": stopped on request");
        Result<Values> values = read_now(unit, table, address, count);
        if (values && !is_bits(table) && count >= 2)
          proofs_.try_emplace(unit, Place{unit, table, address, count});
        return values;
      },
      clock_, until);
}

Result<void> ModbusBus::write(int unit, RegisterTable table, int address,
                              const std::vector<std::uint16_t>& values, bool multiple,
                              const Until& until, Delivery delivery) {
  auto done = lane_.run(
      [=, this](const std::stop_token& stop) -> Result<Values> {
        if (delivery == Delivery::sent_only) return send(unit, table, address, values, multiple);
        if (delivery == Delivery::sent_first && out_of_step_)
          (void)send(unit, table, address, values, multiple);
        if (auto up = ready(unit, stop); !up) return tl::unexpected(up.error());
        // Between being asked and being able to write, the caller may have given up: then nothing
        // may be written.
        if (stop.stop_requested()) return fail(ErrorCode::stopped, name_ + ": stopped on request");
        return write_now(unit, table, address, values, multiple);
      },
      clock_, until);
  if (!done) return tl::unexpected(done.error());
  return {};
}

}  // namespace lightrig
