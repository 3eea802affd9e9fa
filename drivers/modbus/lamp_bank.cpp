// Fixed lamps on consecutive coils of one Modbus unit: choosing one takes the place of moving.
#include <fmt/format.h>

#include <cmath>

#include "drivers/backends.h"
#include "drivers/lamp_power.h"
#include "drivers/modbus/modbus_bus.h"

namespace lightrig {
namespace {

/// Which lamp is meant, and the wire to all of them; used by the session thread alone.
struct LampBank {
  ModbusLamp config;
  std::size_t lamps = 0;
  std::size_t chosen = 0;
  std::unique_ptr<ModbusBus> bus;

  /// All coils in one write, so that never two lamps burn.
  Result<void> light(bool on, const Until& until) {
    std::vector<std::uint16_t> coils(lamps, 0);
    if (on) coils[chosen] = 1;
    return bus->write(config.unit, RegisterTable::coil, config.coil.value_or(0), coils, true, until,
                      on ? Delivery::in_step : Delivery::sent_first);
  }
  Result<std::vector<std::uint16_t>> read(const Until& until) {
    return bus->read(config.unit, RegisterTable::coil, config.coil.value_or(0),
                     static_cast<int>(lamps), until);
  }
};

class LampChooser final : public Gantry {
 public:
  LampChooser(const GantryModel& model, std::shared_ptr<LampBank> bank)
      : model_(model), bank_(std::move(bank)) {}

  Result<void> home(const Until& until) override {
    if (auto dark = bank_->light(false, until); !dark)
      return tl::unexpected(with_context("darken the lamps", dark.error()));
    bank_->chosen = static_cast<std::size_t>(std::lround(model_.axes[0].home));
    homed_ = true;
    return {};
  }

  /// Dark while choosing: a lamp that burns is put out first.
  Result<void> move_to(const GantryPosition& position, const Until& until) override {
    if (!within_limits(model_, position))
      return fail(
          ErrorCode::refused,
          fmt::format("choose a lamp: there is none of that number; there are {}", bank_->lamps));
    if (!homed_) return fail(ErrorCode::refused, "not homed: home first");
    if (auto dark = bank_->light(false, until); !dark)
      return tl::unexpected(with_context("choose a lamp", dark.error()));
    bank_->chosen = static_cast<std::size_t>(std::lround(position.axes[0]));
    return {};
  }

  Result<GantryStatus> status(const Until& until) override {
    auto coils = bank_->read(until);
    if (!coils) return tl::unexpected(with_context("read the lamps", coils.error()));
    GantryStatus status;
    status.position.axes = Eigen::Matrix<double, 1, 1>(static_cast<double>(bank_->chosen));
    status.homed = homed_;
    status.at_rest = true;
    for (std::size_t i = 0; i < coils->size(); ++i)
      if ((*coils)[i] != 0 && i != bank_->chosen)
        status.alarm =
            fmt::format("lamp {} burns although lamp {} was chosen", i + 1, bank_->chosen + 1);
    return status;
  }

  Result<void> clear_fault(const Until& until) override { return bank_->light(false, until); }

 private:
  const GantryModel model_;
  std::shared_ptr<LampBank> bank_;
  bool homed_ = false;
};

class ChosenLamp final : public Lamp {
 public:
  ChosenLamp(std::shared_ptr<LampBank> bank, double most, Clock& clock)
      : bank_(std::move(bank)), most_(most), clock_(clock) {}
  ~ChosenLamp() override { (void)bank_->light(false, {clock_.now() + bank_->bus->farewell(), {}}); }

  Result<void> set(double power, const Until& until) override {
    if (auto allowed = allowed_power(power, most_); !allowed) return allowed;
    auto done = bank_->light(power > 0, until);
    if (!done) return tl::unexpected(with_context("switch the lamp", done.error()));
    return {};
  }
  Result<LampState> state(const Until& until) override {
    auto coils = bank_->read(until);
    if (!coils) return tl::unexpected(with_context("read the lamp", coils.error()));
    return LampState{(*coils)[bank_->chosen] != 0 ? 1.0 : 0.0, true, std::nullopt};
  }

 private:
  std::shared_ptr<LampBank> bank_;
  const double most_;
  Clock& clock_;
};

}  // namespace

Result<GantryAndLamp> open_gantry(const Rig& rig, const FixedLampsGantry&, Clock& clock) {
  const auto* fixed = std::get_if<FixedLampsKinematics>(&rig.gantry.model.kinematics);
  const auto* wires = std::get_if<ModbusLamp>(&rig.lamp.backend);
  if (fixed == nullptr || wires == nullptr || !wires->coil)
    return fail(ErrorCode::invalid_input,
                "fixed lamps need kinematics \"lamps\" and a [lamp.modbus] with a coil");
  auto bus = ModbusBus::open(wires->endpoint, wires->timeout, {}, clock);
  if (!bus) return tl::unexpected(bus.error());
  auto bank = std::make_shared<LampBank>(LampBank{*wires, fixed->lamps.size(), 0, std::move(*bus)});
  // Whatever an earlier program left burning goes dark now.
  if (auto dark = bank->light(false, {clock.now() + 2 * wires->timeout, {}}); !dark)
    return tl::unexpected(dark.error());
  GantryAndLamp opened;
  opened.gantry = std::make_unique<LampChooser>(rig.gantry.model, bank);
  opened.lamp = std::make_unique<ChosenLamp>(bank, rig.lamp.max_power, clock);
  return opened;
}

}  // namespace lightrig
