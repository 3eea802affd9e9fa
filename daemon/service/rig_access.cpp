#include "daemon/service/rig_access.h"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <condition_variable>
#include <mutex>

#include "config/load_object.h"
#include "daemon/session/guarded_move.h"
#include "sim/memory_devices.h"
#include "sim/open_devices.h"
#include "sim/sim_clock.h"
#include "sim/world.h"

namespace lightrig {
namespace {

using namespace std::chrono_literals;

constexpr std::chrono::seconds answer_time{5};    ///< for a question that moves nothing
constexpr std::chrono::seconds braking_time{10};  ///< of an arm that was stopped

/// Devices being opened on a thread of their own, and whoever waits for them.
class Opening {
 public:
  bool is_left() {
    const std::lock_guard lock(mutex_);
    return left_;
  }
  /// Nobody waits any more: the devices are destroyed here, on the thread that opened them.
  void done(Result<Devices> opened) {
    const std::lock_guard lock(mutex_);
    if (left_) return;
    opened_ = std::move(opened);
    woken_.notify_all();
  }
  Result<Devices> wait(const std::stop_token& stop) {
    std::unique_lock lock(mutex_);
    if (woken_.wait(lock, stop, [this] { return opened_.has_value(); })) return std::move(*opened_);
    left_ = true;
    return fail(ErrorCode::stopped, "open the devices: stopped on request");
  }

 private:
  std::mutex mutex_;
  std::condition_variable_any woken_;
  std::optional<Result<Devices>> opened_;
  bool left_ = false;
};

}  // namespace

RigAccess::RigAccess(const Rig& rig, bool simulate, double clock_rate)
    : rig_(rig), simulate_(simulate) {
  if (simulate)
    clock_ = sim::make_clock(clock_rate);
  else
    clock_ = std::make_unique<RealClock>();
}

RigAccess::~RigAccess() = default;

Until RigAccess::within(std::chrono::nanoseconds time, const std::stop_token& stop) const {
  return {clock_->now() + time, stop};
}

Result<RigFacts> RigAccess::open(const ObjectConfig& object, const std::stop_token& stop) {
  devices_.reset();
  set_object(object);
  if (simulate_) {
    auto world =
        sim::make_world(rig_, object, *clock_, rig_.simulation ? rig_.simulation->seed : 1);
    if (!world) return tl::unexpected(with_context("simulate the rig", world.error()));
    world_ = std::move(*world);
  }
  auto opened = reopen(Reopen::everything, {}, stop);
  if (!opened) return tl::unexpected(opened.error());
  devices_ = std::move(*opened);
  if (auto dark = devices_->lamp->set(0, within(answer_time, stop)); !dark) {
    devices_.reset();
    return tl::unexpected(with_context("make the lamp dark", dark.error()));
  }
  auto now = facts_at_rest(stop);
  if (!now) devices_.reset();
  return now;
}

// An abort's stop may still brake the arm: taken for its place, where it is now would differ from
// where it comes to rest, as if it had moved by itself.
Result<RigFacts> RigAccess::facts_at_rest(const std::stop_token& stop) {
  const TimePoint latest = clock_->now() + braking_time;
  while (true) {
    auto now = facts(stop);
    // What stands in the way anyhow is said at once.
    if (!now || now->gantry.at_rest || !now->gantry.alarm.empty() ||
        !now->gantry.open_interlocks.empty())
      return now;
    if (stop.stop_requested()) return fail(ErrorCode::stopped, "the gantry still moves; stopped");
    if (clock_->now() >= latest)
      return fail(ErrorCode::refused,
                  fmt::format("the gantry has not come to rest within {} s, and nothing here moves "
                              "it: find out what does, another program or a pendant",
                              braking_time.count()));
    clock_->sleep_until(clock_->now() + std::chrono::milliseconds(50), stop);
  }
}

Result<Devices> RigAccess::open_now(Reopen what) {
  if (what == Reopen::everything)
    return simulate_ ? sim::open_devices(rig_, world_) : open_devices(rig_, *clock_);
  Devices only;
  if (what == Reopen::lamp) {
    auto lamp = simulate_ ? Result<std::unique_ptr<Lamp>>(sim::make_lamp(world_))
                          : open_lamp(rig_, *clock_);
    if (!lamp) return tl::unexpected(lamp.error());
    only.lamp = std::move(*lamp);
    return only;
  }
  if (simulate_) {
    only.camera = sim::make_camera(world_);
    return only;
  }
  auto camera = open_camera(rig_, *clock_);
  if (!camera) return tl::unexpected(camera.error());
  only.camera = std::move(*camera);
  return only;
}

Result<Devices> RigAccess::reopen(Reopen what, std::unique_ptr<Camera> old,
                                  const std::stop_token& stop) {
  if (simulate_) {
    old.reset();
    return open_now(what);
  }
  auto opening = std::make_shared<Opening>();
  opening_ = std::jthread(
      [this, what, opening, old = std::move(old), earlier = std::move(opening_)]() mutable {
        if (earlier.joinable()) earlier.join();
        old.reset();
        Result<Devices> opened = fail(ErrorCode::stopped, "open the devices: stopped on request");
        if (!opening->is_left()) opened = open_now(what);
        opening->done(std::move(opened));
      });
  return opening->wait(stop);
}

void RigAccess::set_take(std::uint64_t take) {
  if (world_) world_->set_take(take);
}

bool RigAccess::close() {
  lamp_until_.reset();
  if (!devices_) return true;
  // A lamp that could not be reopened is beyond us. The stop that ends a session must not keep it
  // from going dark: a token of its own.
  const bool dark = devices_->lamp ? devices_->lamp->set(0, within(answer_time, {})).has_value()
                                   : lamp_left_dark_;
  lamp_left_dark_ = false;
  devices_.reset();
  return dark;
}

Result<void> RigAccess::all_open() const {
  if (!devices_ || !devices_->gantry || !devices_->lamp || !devices_->camera)
    return fail(ErrorCode::disconnected, "a device was lost and could not be opened again");
  return {};
}

Result<RigFacts> RigAccess::facts(const std::stop_token& stop) {
  if (auto open = all_open(); !open) return tl::unexpected(open.error());
  RigFacts facts;
  auto gantry = devices_->gantry->status(within(answer_time, stop));
  if (!gantry) return tl::unexpected(with_context("ask the gantry how it is", gantry.error()));
  facts.gantry = std::move(*gantry);
  auto lamp = devices_->lamp->state(within(answer_time, stop));
  if (!lamp) return tl::unexpected(with_context("ask the lamp how it is", lamp.error()));
  facts.lamp = *lamp;
  facts.camera = devices_->camera->identity();
  return facts;
}

Result<void> RigAccess::home(const std::stop_token& stop) {
  if (auto open = all_open(); !open)
    return tl::unexpected(with_context("home the gantry", open.error()));
  auto status = devices_->gantry->status(within(answer_time, stop));
  if (!status) return tl::unexpected(with_context("home the gantry", status.error()));
  if (const std::string why = obstacle(*status); !why.empty())
    return fail(ErrorCode::refused, "home the gantry: " + why);
  auto homed = devices_->gantry->home(within(rig_.gantry.homing_timeout, stop));
  if (!homed) return tl::unexpected(with_context("home the gantry", homed.error()));
  return {};
}

Result<void> RigAccess::clear_fault(const std::stop_token& stop) {
  if (auto open = all_open(); !open) return open;
  return devices_->gantry->clear_fault(within(answer_time, stop));
}

Result<LampState> RigAccess::set_lamp(double power, const std::stop_token& stop) {
  if (!(power >= 0 && power <= rig_.lamp.max_power))
    return fail(ErrorCode::refused, fmt::format("set the lamp: the rig file allows 0 … {}, not {}",
                                                rig_.lamp.max_power, power));
  if (!devices_ || !devices_->lamp)
    return fail(ErrorCode::disconnected, "set the lamp: it was lost and could not be opened again");
  // What forbids light forbids no darkness; nor does a gantry that is silent.
  if (power > 0) {
    if (auto open = all_open(); !open)
      return tl::unexpected(with_context("set the lamp", open.error()));
    auto status = devices_->gantry->status(within(answer_time, stop));
    if (!status) return tl::unexpected(with_context("set the lamp", status.error()));
    if (const std::string why = obstacle(*status); !why.empty())
      return fail(ErrorCode::refused, "set the lamp: " + why);
    lamp_until_ = clock_->now() + rig_.lamp.max_on_time;  // whatever becomes of the call
  }
  if (auto set = devices_->lamp->set(power, within(answer_time, stop)); !set)
    return tl::unexpected(with_context("set the lamp", set.error()));
  if (power == 0) lamp_until_.reset();
  auto state = devices_->lamp->state(within(answer_time, stop));
  if (!state) return tl::unexpected(with_context("ask the lamp how it is", state.error()));
  return state;
}

bool RigAccess::lease_covers(std::chrono::nanoseconds time) const {
  return !lamp_until_ || clock_->now() + time < *lamp_until_;
}

Result<void> RigAccess::heed_lease() {
  if (!devices_ || !devices_->lamp || !lamp_until_ || clock_->now() < *lamp_until_) return {};
  if (auto dark = devices_->lamp->set(0, within(answer_time, {})); !dark)
    return tl::unexpected(with_context("end the lamp's lease", dark.error()));
  lamp_until_.reset();
  return {};
}

Result<Frame> RigAccess::expose(double seconds, const std::stop_token& stop) {
  if (auto open = all_open(); !open)
    return tl::unexpected(with_context("take a frame", open.error()));
  const auto time = std::chrono::duration_cast<std::chrono::nanoseconds>(
      std::chrono::duration<double>(seconds + rig_.camera.readout_time));
  auto frame = devices_->camera->expose(seconds, within(time + answer_time, stop));
  if (!frame) return tl::unexpected(with_context("take a frame", frame.error()));
  return frame;
}

// What stands in the way beside the rig's own volumes: loaded once somebody wants to move.
Result<void> RigAccess::know_obstacles() {
  if (obstacles_) return {};
  std::optional<LoadedObject> object;
  if (rig_.gantry.solid) {
    auto loaded = load_object(object_);
    if (!loaded)
      return fail(ErrorCode::refused,  // nothing is wrong with the rig
                  "know where the object stands: " + loaded.error().message);
    object = std::move(*loaded);
  }
  obstacles_ = obstacles_of(rig_, object ? &object->mesh : nullptr);
  return {};
}

Result<void> RigAccess::move_to(const GantryPosition& target, const std::stop_token& stop) {
  if (auto open = all_open(); !open)
    return tl::unexpected(with_context("move the gantry", open.error()));
  if (auto known = know_obstacles(); !known)
    return tl::unexpected(with_context("move the gantry", known.error()));
  const auto status = devices_->gantry->status(within(answer_time, stop));
  if (!status) return tl::unexpected(with_context("move the gantry", status.error()));
  auto moved = guarded_move(rig_, *obstacles_, *devices_->gantry, *status, target, *clock_, stop);
  if (!moved) return tl::unexpected(with_context("move the gantry", moved.error()));
  return {};
}

void RigAccess::set_object(const ObjectConfig& object) {
  object_ = object;
  obstacles_.reset();
}

}  // namespace lightrig
