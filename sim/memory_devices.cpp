#include "sim/memory_devices.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <utility>

namespace lightrig::sim {
namespace {

using namespace std::chrono_literals;

tl::unexpected<Error> stopped(const char* doing) {
  return fail(ErrorCode::stopped, std::string(doing) + " was stopped on request");
}

/// A call with no time left, or asked to stop, never begins.
Result<void> may_begin(Clock& clock, const Until& until, const char* doing) {
  if (until.stop.stop_requested()) return stopped(doing);
  if (clock.now() >= until.deadline) {
    return fail(ErrorCode::timed_out, std::string(doing) + " had no time left before it began");
  }
  return {};
}

double seconds(std::chrono::nanoseconds time) {
  return std::chrono::duration<double>(time).count();
}

class MemoryGantry final : public Gantry {
 public:
  explicit MemoryGantry(std::shared_ptr<World> world) : world_(std::move(world)) {}
  MemoryGantry(const MemoryGantry&) = delete;
  MemoryGantry& operator=(const MemoryGantry&) = delete;
  ~MemoryGantry() override { world_->halt_gantry(); }

  Result<void> home(const Until& until) override {
    if (auto begun = may_begin(world_->clock(), until, "homing"); !begun) return begun;
    return follow(world_->start_homing(), until, "homing");
  }

  Result<void> move_to(const GantryPosition& position, const Until& until) override {
    if (auto begun = may_begin(world_->clock(), until, "the move"); !begun) return begun;
    return follow(world_->start_move(position), until, "the move");
  }

  Result<GantryStatus> status(const Until& until) override {
    if (auto begun = may_begin(world_->clock(), until, "reading the gantry"); !begun) {
      return tl::unexpected(begun.error());
    }
    return world_->gantry_status();
  }

  Result<void> clear_fault(const Until& until) override {
    if (auto begun = may_begin(world_->clock(), until, "clearing the fault"); !begun) return begun;
    return world_->clear_fault();
  }

 private:
  /// Waits for a motion that has been started; leaves it halted when it does not arrive.
  Result<void> follow(const Result<TimePoint>& arrival, const Until& until, const char* doing) {
    if (!arrival) return tl::unexpected(arrival.error());
    Clock& clock = world_->clock();
    // Looked at every few milliseconds, as a driver polls: an interlock may halt it on the way.
    while (true) {
      const TimePoint now = clock.now();
      if (until.stop.stop_requested()) {
        world_->halt_gantry();
        return stopped(doing);
      }
      const GantryStatus status = world_->gantry_status();
      if (!status.open_interlocks.empty() || !status.alarm.empty()) {
        return fail(ErrorCode::refused,
                    status.alarm.empty()
                        ? fmt::format("{} was halted: interlock \"{}\" opened; close it, clear the "
                                      "fault, home if asked",
                                      doing, status.open_interlocks.front())
                        : fmt::format("{} was halted by alarm \"{}\": mend the cause and clear "
                                      "the fault",
                                      doing, status.alarm));
      }
      if (now >= *arrival) return {};
      if (now >= until.deadline) {
        world_->halt_gantry();
        return fail(ErrorCode::timed_out,
                    fmt::format("{} was {:.3f} s short of arriving at its deadline and was halted",
                                doing, seconds(*arrival - now)));
      }
      clock.sleep_until(std::min({*arrival, until.deadline, now + 5ms}), until.stop);
    }
  }

  std::shared_ptr<World> world_;
};

class MemoryLamp final : public Lamp {
 public:
  explicit MemoryLamp(std::shared_ptr<World> world) : world_(std::move(world)) {}
  MemoryLamp(const MemoryLamp&) = delete;
  MemoryLamp& operator=(const MemoryLamp&) = delete;
  ~MemoryLamp() override { static_cast<void>(world_->set_lamp(0)); }  // 0 is never refused

  Result<void> set(double power, const Until& until) override {
    if (auto begun = may_begin(world_->clock(), until, "setting the lamp"); !begun) return begun;
    return world_->set_lamp(power);
  }

  Result<LampState> state(const Until& until) override {
    if (auto begun = may_begin(world_->clock(), until, "reading the lamp"); !begun) {
      return tl::unexpected(begun.error());
    }
    return LampState{world_->lamp_power(), true, world_->lamp_temperature()};
  }

 private:
  std::shared_ptr<World> world_;
};

class MemoryCamera final : public Camera {
 public:
  explicit MemoryCamera(std::shared_ptr<World> world) : world_(std::move(world)) {}

  /// The picture is taken of the world at mid-exposure; the frame is in hand after the readout. The
  /// time this machine takes to render is not the camera's and does not count against the deadline.
  Result<Frame> expose(double exposure, const Until& until) override {
    Clock& clock = world_->clock();
    if (auto begun = may_begin(clock, until, "the exposure"); !begun) {
      return tl::unexpected(begun.error());
    }
    // A camera refuses such an exposure at once, not after having waited it out.
    const SensorModel& sensor = world_->rig().camera.sensor;
    if (!(exposure >= sensor.min_exposure && exposure <= sensor.max_exposure)) {
      return world_->expose(world_->look(), exposure, until.stop);
    }
    const TimePoint begin = clock.now();
    const auto after = [begin](double s) {
      return begin + std::chrono::nanoseconds(std::llround(s * 1e9));
    };
    const TimePoint middle = after(exposure / 2);
    const TimePoint in_hand = after(exposure + world_->rig().camera.readout_time);
    clock.sleep_until(std::min(middle, until.deadline), until.stop);
    if (until.stop.stop_requested()) return stopped("the exposure");
    if (in_hand > until.deadline) {
      clock.sleep_until(until.deadline, until.stop);
      if (until.stop.stop_requested()) return stopped("the exposure");
      return fail(
          ErrorCode::timed_out,
          fmt::format("no frame by the deadline: exposure and readout take {:.3f} s, {:.3f} "
                      "s were allowed",
                      seconds(in_hand - begin), seconds(until.deadline - begin)));
    }
    auto frame = world_->expose(world_->look(), exposure, until.stop);
    if (!frame) return frame;
    clock.sleep_until(in_hand, until.stop);
    if (until.stop.stop_requested()) return stopped("the exposure");
    return received(std::move(*frame));
  }

  CameraCounters counters() const override {
    CameraCounters counters = counters_;
    counters.temperature_c = world_->camera_temperature();
    return counters;
  }
  std::string identity() const override {
    return fmt::format("lightrig simulated camera {}x{} {} bit", world_->rig().camera.model.width,
                       world_->rig().camera.model.height, world_->rig().camera.sensor.bits);
  }

 private:
  /// What comes through the packets of the day.
  Result<Frame> received(Frame frame) {
    const PacketWeather weather = world_->packet_weather();
    counters_.packets_resent += weather.resent_per_frame;
    counters_.packets_lost += weather.lost_per_frame;
    if (weather.lost_per_frame > 0) {
      ++counters_.rejected;
      return fail(ErrorCode::timed_out,
                  fmt::format("{} packets of the frame were lost and not sent again",
                              weather.lost_per_frame));
    }
    ++counters_.frames;
    return frame;
  }

  std::shared_ptr<World> world_;
  CameraCounters counters_;
};

}  // namespace

std::unique_ptr<Gantry> make_gantry(std::shared_ptr<World> world) {
  return std::make_unique<MemoryGantry>(std::move(world));
}
std::unique_ptr<Lamp> make_lamp(std::shared_ptr<World> world) {
  return std::make_unique<MemoryLamp>(std::move(world));
}
std::unique_ptr<Camera> make_camera(std::shared_ptr<World> world) {
  return std::make_unique<MemoryCamera>(std::move(world));
}

}  // namespace lightrig::sim
