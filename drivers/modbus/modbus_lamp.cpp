// A lamp on a Modbus unit of its own: a coil, or a holding register whose full scale is power 1.
#include <fmt/format.h>

#include <cmath>

#include "drivers/backends.h"
#include "drivers/lamp_power.h"
#include "drivers/modbus/modbus_lamp.h"

namespace lightrig {
namespace {

class ModbusLampDevice final : public Lamp {
 public:
  ModbusLampDevice(const ModbusLamp& config, double most, Clock& clock,
                   std::shared_ptr<ModbusBus> bus)
      : config_(config), most_(most), clock_(clock), bus_(std::move(bus)) {}
  ~ModbusLampDevice() override { (void)set(0, {clock_.now() + bus_->farewell(), {}}); }

  Result<void> set(double power, const Until& until) override {
    if (auto allowed = allowed_power(power, most_); !allowed) return allowed;
    const auto raw = config_.coil
                         ? static_cast<std::uint16_t>(power > 0 ? 1 : 0)
                         : static_cast<std::uint16_t>(std::lround(power * config_.full_scale));
    auto done = bus_->write(config_.unit, table(), address(), {raw}, false, until,
                            power > 0 ? Delivery::in_step : Delivery::sent_first);
    if (!done) return tl::unexpected(with_context("switch the lamp", done.error()));
    return {};
  }

  Result<LampState> state(const Until& until) override {
    auto words = bus_->read(config_.unit, table(), address(), 1, until);
    if (!words) return tl::unexpected(with_context("read the lamp", words.error()));
    const double full = config_.coil ? 1.0 : config_.full_scale;
    LampState state{words->front() / full, true, std::nullopt};
    if (config_.temperature) {
      auto count = bus_->read(config_.unit, RegisterTable::holding, *config_.temperature, 1, until);
      if (!count) return tl::unexpected(with_context("read the lamp's temperature", count.error()));
      state.temperature_c = static_cast<std::int16_t>(count->front()) * config_.degrees_per_count;
    }
    return state;
  }

 private:
  RegisterTable table() const {
    return config_.coil ? RegisterTable::coil : RegisterTable::holding;
  }
  int address() const { return config_.coil ? *config_.coil : config_.holding.value_or(0); }

  const ModbusLamp config_;
  const double most_;
  Clock& clock_;
  std::shared_ptr<ModbusBus> bus_;
};

}  // namespace

Result<std::unique_ptr<Lamp>> make_modbus_lamp(const Rig& rig, const ModbusLamp& config,
                                               Clock& clock, std::shared_ptr<ModbusBus> bus) {
  std::unique_ptr<Lamp> lamp =
      std::make_unique<ModbusLampDevice>(config, rig.lamp.max_power, clock, std::move(bus));
  // Whatever an earlier program left burning goes dark now.
  if (auto dark = lamp->set(0, {clock.now() + 2 * config.timeout, {}}); !dark)
    return tl::unexpected(dark.error());
  return lamp;
}

Result<std::unique_ptr<Lamp>> open_lamp(const Rig& rig, const ModbusLamp& backend, Clock& clock) {
  auto bus = ModbusBus::open(backend.endpoint, backend.timeout, {}, clock);
  if (!bus) return tl::unexpected(bus.error());
  return make_modbus_lamp(rig, backend, clock, std::move(*bus));
}

}  // namespace lightrig
