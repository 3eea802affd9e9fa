#include "sim/faults.h"

#include <fmt/format.h>

#include <utility>

namespace lightrig::sim {
namespace {

tl::unexpected<Error> no_answer(Clock& clock, const Until& until, DeviceCall call) {
  clock.sleep_until(until.deadline, until.stop);
  if (until.stop.stop_requested()) {
    return fail(ErrorCode::stopped, fmt::format("{} was stopped on request", name_of(call)));
  }
  return fail(ErrorCode::timed_out,
              fmt::format("{}: no answer before the deadline (scripted fault)", name_of(call)));
}

tl::unexpected<Error> gone(DeviceCall call) {
  return fail(ErrorCode::disconnected,
              fmt::format("{}: the device is gone (scripted fault): open it again", name_of(call)));
}

/// What all three decorated devices share: the script, the clock, and whether the wire is cut.
class Faulty {
 public:
  Faulty(std::shared_ptr<FaultScript> script, Clock& clock)
      : script_(std::move(script)), clock_(clock) {}

 protected:
  /// Runs a call through the script: `carry_out` does it, `pretend` is the success that is none.
  template <class T, class CarryOut, class Pretend>
  Result<T> call(DeviceCall kind, const Until& until, const CarryOut& carry_out,
                 const Pretend& pretend) {
    const std::optional<FaultEffect> effect = script_->next(kind);
    if (cut_) return gone(kind);
    if (!effect) return carry_out();
    switch (*effect) {
      case FaultEffect::timed_out:
        return no_answer(clock_, until, kind);
      case FaultEffect::answer_lost: {
        const Result<T> unseen = carry_out();
        if (!unseen && unseen.error().code == ErrorCode::stopped) return unseen;
        return no_answer(clock_, until, kind);
      }
      case FaultEffect::disconnected:
        cut_ = true;
        return gone(kind);
      case FaultEffect::refused:
        break;
      default:
        if (auto result = pretend(*effect)) return std::move(*result);
    }
    return fail(ErrorCode::refused,
                fmt::format("{}: refused by the device (scripted fault)", name_of(kind)));
  }

  Clock& clock() const { return clock_; }

 private:
  std::shared_ptr<FaultScript> script_;
  Clock& clock_;
  bool cut_ = false;
};

constexpr auto no_pretence = [](FaultEffect) -> std::optional<Result<void>> {
  return std::nullopt;
};

class FaultyGantry final : public Gantry, Faulty {
 public:
  FaultyGantry(std::unique_ptr<Gantry> gantry, std::shared_ptr<FaultScript> script, Clock& clock)
      : Faulty(std::move(script), clock), gantry_(std::move(gantry)) {}

  Result<void> home(const Until& until) override {
    return call<void>(
        DeviceCall::gantry_home, until, [&] { return gantry_->home(until); },
        [](FaultEffect effect) -> std::optional<Result<void>> {
          if (effect != FaultEffect::ignored) return std::nullopt;
          return Result<void>{};
        });
  }

  Result<void> move_to(const GantryPosition& position, const Until& until) override {
    const auto pretend = [&](FaultEffect effect) -> std::optional<Result<void>> {
      if (effect == FaultEffect::ignored) return Result<void>{};
      if (effect != FaultEffect::short_move) return std::nullopt;
      const Result<GantryStatus> here = gantry_->status(until);
      if (!here) return Result<void>(tl::unexpected(here.error()));
      GantryPosition early;
      early.axes = position.axes - 0.1 * (position.axes - here->position.axes);
      return gantry_->move_to(early, until);
    };
    return call<void>(
        DeviceCall::gantry_move, until, [&] { return gantry_->move_to(position, until); }, pretend);
  }

  Result<GantryStatus> status(const Until& until) override {
    return call<GantryStatus>(
        DeviceCall::gantry_status, until, [&] { return gantry_->status(until); },
        [](FaultEffect) -> std::optional<Result<GantryStatus>> { return std::nullopt; });
  }

  Result<void> clear_fault(const Until& until) override {
    return call<void>(
        DeviceCall::gantry_clear_fault, until, [&] { return gantry_->clear_fault(until); },
        no_pretence);
  }

 private:
  std::unique_ptr<Gantry> gantry_;
};

class FaultyLamp final : public Lamp, Faulty {
 public:
  FaultyLamp(std::unique_ptr<Lamp> lamp, std::shared_ptr<FaultScript> script, Clock& clock)
      : Faulty(std::move(script), clock), lamp_(std::move(lamp)) {}

  Result<void> set(double power, const Until& until) override {
    return call<void>(
        DeviceCall::lamp_set, until, [&] { return lamp_->set(power, until); },
        [](FaultEffect effect) -> std::optional<Result<void>> {
          if (effect != FaultEffect::ignored) return std::nullopt;
          return Result<void>{};
        });
  }

  Result<LampState> state(const Until& until) override {
    return call<LampState>(
        DeviceCall::lamp_state, until, [&] { return lamp_->state(until); },
        [](FaultEffect) -> std::optional<Result<LampState>> { return std::nullopt; });
  }

 private:
  std::unique_ptr<Lamp> lamp_;
};

class FaultyCamera final : public Camera, Faulty {
 public:
  FaultyCamera(std::unique_ptr<Camera> camera, std::shared_ptr<FaultScript> script, Clock& clock)
      : Faulty(std::move(script), clock), camera_(std::move(camera)) {}

  Result<Frame> expose(double seconds, const Until& until) override {
    const auto pretend = [&](FaultEffect effect) -> std::optional<Result<Frame>> {
      switch (effect) {
        case FaultEffect::wrong_exposure:
          return camera_->expose(2 * seconds, until);
        case FaultEffect::stale_frame:
          if (last_) return Result<Frame>(*last_);
          return Result<Frame>(no_answer(clock(), until, DeviceCall::camera_expose));
        case FaultEffect::wrong_size: {
          Result<Frame> frame = camera_->expose(seconds, until);
          if (frame) {
            frame->counts.height /= 2;
            frame->counts.counts.resize(static_cast<std::size_t>(frame->counts.height) *
                                        static_cast<std::size_t>(frame->counts.width));
          }
          return frame;
        }
        default:
          return std::nullopt;
      }
    };
    const auto carry_out = [&] {
      Result<Frame> frame = camera_->expose(seconds, until);
      if (frame) last_ = *frame;
      return frame;
    };
    return call<Frame>(DeviceCall::camera_expose, until, carry_out, pretend);
  }

  CameraCounters counters() const override { return camera_->counters(); }
  std::string identity() const override { return camera_->identity(); }

 private:
  std::unique_ptr<Camera> camera_;
  std::optional<Frame> last_;
};

}  // namespace

std::string_view name_of(DeviceCall call) {
  switch (call) {
    case DeviceCall::any:
      return "any";
    case DeviceCall::gantry_home:
      return "gantry_home";
    case DeviceCall::gantry_move:
      return "gantry_move";
    case DeviceCall::gantry_status:
      return "gantry_status";
    case DeviceCall::gantry_clear_fault:
      return "gantry_clear_fault";
    case DeviceCall::lamp_set:
      return "lamp_set";
    case DeviceCall::lamp_state:
      return "lamp_state";
    case DeviceCall::camera_expose:
      return "camera_expose";
  }
  return "unknown";
}

std::string_view name_of(FaultEffect effect) {
  switch (effect) {
    case FaultEffect::timed_out:
      return "timed_out";
    case FaultEffect::answer_lost:
      return "answer_lost";
    case FaultEffect::disconnected:
      return "disconnected";
    case FaultEffect::refused:
      return "refused";
    case FaultEffect::ignored:
      return "ignored";
    case FaultEffect::short_move:
      return "short_move";
    case FaultEffect::wrong_exposure:
      return "wrong_exposure";
    case FaultEffect::stale_frame:
      return "stale_frame";
    case FaultEffect::wrong_size:
      return "wrong_size";
  }
  return "unknown";
}

std::optional<FaultEffect> FaultScript::next(DeviceCall call) {
  const std::lock_guard lock(mutex_);
  const std::uint64_t of_kind = ++calls_[call];
  const std::uint64_t of_all = ++calls_[DeviceCall::any];
  for (const Fault& fault : faults_) {
    const bool strikes = fault.call == DeviceCall::any ? fault.nth == of_all
                                                       : fault.call == call && fault.nth == of_kind;
    if (!strikes) continue;
    struck_.push_back(fault);
    return fault.effect;
  }
  return std::nullopt;
}

std::uint64_t FaultScript::calls(DeviceCall call) const {
  const std::lock_guard lock(mutex_);
  const auto found = calls_.find(call);
  return found == calls_.end() ? 0 : found->second;
}

std::vector<Fault> FaultScript::struck() const {
  const std::lock_guard lock(mutex_);
  return struck_;
}

Devices with_faults(Devices devices, std::shared_ptr<FaultScript> script, Clock& clock) {
  Devices faulty;
  faulty.camera = std::make_unique<FaultyCamera>(std::move(devices.camera), script, clock);
  faulty.gantry = std::make_unique<FaultyGantry>(std::move(devices.gantry), script, clock);
  faulty.lamp = std::make_unique<FaultyLamp>(std::move(devices.lamp), script, clock);
  return faulty;
}

}  // namespace lightrig::sim
