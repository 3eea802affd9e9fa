// Gantry, lamp and accidents of the laboratory.
#include "sim/world.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "core/check.h"
#include "sim/parallel.h"

namespace lightrig::sim {
namespace {

constexpr double homing_speed_share = 0.25;

/// Where an unhomed gantry happens to stand when the laboratory opens.
GantryPosition parked(const GantryModel& gantry) {
  GantryPosition position;
  position.axes.resize(static_cast<Eigen::Index>(gantry.axes.size()));
  for (std::size_t i = 0; i < gantry.axes.size(); ++i) {
    const Axis& axis = gantry.axes[i];
    const double somewhere = axis.min + 0.3 * (axis.max - axis.min);
    position.axes[static_cast<Eigen::Index>(i)] = axis.selector ? std::round(somewhere) : somewhere;
  }
  return position;
}

/// Called before anything else looks at rig.simulation.
ArmModel arm_of(const Rig& rig) {
  CHECK(rig.simulation.has_value());
  return {rig.simulation->arm_frequency, rig.simulation->arm_damping};
}

std::string axis_value(const Axis& axis, double value) { return value_text(axis, value, 4); }

/// Which axis leaves its travel, with the numbers; "" when none does.
std::string beyond_limits(const GantryModel& gantry, const GantryPosition& to) {
  if (to.axes.size() != static_cast<Eigen::Index>(gantry.axes.size())) {
    return fmt::format("{} axis values for {} axes", to.axes.size(), gantry.axes.size());
  }
  for (std::size_t i = 0; i < gantry.axes.size(); ++i) {
    const Axis& axis = gantry.axes[i];
    const double value = to.axes[static_cast<Eigen::Index>(i)];
    if (!(value >= axis.min && value <= axis.max)) {
      return fmt::format("{} to {} is outside its travel of {} to {}", axis.name,
                         axis_value(axis, value), axis_value(axis, axis.min),
                         axis_value(axis, axis.max));
    }
  }
  return "";
}

}  // namespace

World::World(const Rig& rig, Mesh object, Reflectance truth, Clock& clock, std::uint64_t seed,
             const RenderOptions& options)
    : rig_(rig),
      clock_(clock),
      seed_(seed),
      threads_(thread_count(options.threads)),
      render_options_(options),
      object_(std::move(object)),
      truth_(std::move(truth)),
      dynamics_(rig.gantry.model, arm_of(rig), parked(rig.gantry.model), clock.now()),
      lamp_until_(clock.now()),
      opened_(clock.now()) {
  seen_.emplace(0.0,
                Renderer(object_, rig.camera.model, rig.camera.sensor.filter, truth_, options));
}

// --- gantry

bool World::homed_at(TimePoint time) const { return homed_from_ && time >= *homed_from_; }

Result<void> World::may_move() const {
  if (!open_interlocks_.empty()) {
    return fail(ErrorCode::refused,
                fmt::format("interlock \"{}\" is open: close it and clear the fault",
                            *open_interlocks_.begin()));
  }
  if (!alarm_.empty()) {
    return fail(
        ErrorCode::refused,
        fmt::format("the drive reports alarm \"{}\": mend the cause and clear the fault", alarm_));
  }
  return {};
}

/// A motion command begins a new count of identical exposures.
void World::gantry_commanded() { requests_.clear(); }

Result<TimePoint> World::start_homing() {
  const std::lock_guard lock(mutex_);
  if (auto allowed = may_move(); !allowed) return tl::unexpected(allowed.error());
  gantry_commanded();
  return seek_home();
}

/// Homing ends at its switches, wherever it comes from.
TimePoint World::seek_home() {
  GantryPosition home;
  home.axes.resize(static_cast<Eigen::Index>(rig_.gantry.model.axes.size()));
  for (std::size_t i = 0; i < rig_.gantry.model.axes.size(); ++i) {
    home.axes[static_cast<Eigen::Index>(i)] = rig_.gantry.model.axes[i].home;
  }
  homed_from_ = dynamics_.move(clock_.now(), home, homing_speed_share);
  seeking_.clear();
  return *homed_from_;
}

Result<TimePoint> World::start_axis_homing(std::size_t axis) {
  const std::lock_guard lock(mutex_);
  if (auto allowed = may_move(); !allowed) return tl::unexpected(allowed.error());
  gantry_commanded();
  const TimePoint now = clock_.now();
  const bool homed = homed_at(now);
  GantryPosition to{dynamics_.destination()};
  to.axes[static_cast<Eigen::Index>(axis)] = rig_.gantry.model.axes[axis].home;
  const TimePoint rest = dynamics_.move(now, to, homing_speed_share);
  // All knew where they are: the others stay so.
  if (homed)
    for (std::size_t i = 0; i < rig_.gantry.model.axes.size(); ++i) seeking_[i] = now;
  // Those that are still on their way come to rest with this one.
  for (auto& [other, until] : seeking_) until = until > now ? rest : until;
  seeking_[axis] = rest;
  if (seeking_.size() == rig_.gantry.model.axes.size())
    homed_from_ = rest;
  else
    homed_from_.reset();
  return rest;
}

bool World::axis_homed(std::size_t axis) const {
  const std::lock_guard lock(mutex_);
  const TimePoint now = clock_.now();
  const auto own = seeking_.find(axis);
  return homed_at(now) || (own != seeking_.end() && now >= own->second);
}

Result<TimePoint> World::start_move(const GantryPosition& to, double speed_share) {
  const std::lock_guard lock(mutex_);
  return start_move_locked(to, speed_share);
}

Result<TimePoint> World::start_move_locked(const GantryPosition& to, double speed_share) {
  if (auto allowed = may_move(); !allowed) return tl::unexpected(allowed.error());
  if (!homed_at(clock_.now())) {
    return fail(ErrorCode::refused, "the gantry does not know where it is: home it first");
  }
  if (const std::string beyond = beyond_limits(rig_.gantry.model, to); !beyond.empty()) {
    return fail(ErrorCode::refused, beyond);
  }
  gantry_commanded();
  return dynamics_.move(clock_.now(), to, speed_share);
}

Result<TimePoint> World::start_axis_move(std::size_t axis, double to) {
  const std::lock_guard lock(mutex_);
  GantryPosition destination;
  destination.axes = dynamics_.destination();
  destination.axes[static_cast<Eigen::Index>(axis)] = to;
  return start_move_locked(destination);
}

void World::halt_gantry() {
  const std::lock_guard lock(mutex_);
  halt_locked();
}

std::vector<TimePoint> World::halts() const {
  const std::lock_guard lock(mutex_);
  return halts_;
}

void World::halt_locked() {
  const TimePoint now = clock_.now();
  forget_unfinished_homing(now);
  if (!dynamics_.at(now).moving) return;
  halts_.push_back(now);
  gantry_commanded();
  dynamics_.halt(now);
}

void World::forget_unfinished_homing(TimePoint now) {
  if (homed_from_ && now < *homed_from_) homed_from_.reset();
  if (!homed_from_) std::erase_if(seeking_, [&](const auto& one) { return now < one.second; });
}

// Those that go on slow down first and start again: the description of a motion is one of all axes.
void World::halt_axis(std::size_t axis) {
  const std::lock_guard lock(mutex_);
  const TimePoint now = clock_.now();
  const GantryMotionState motion = dynamics_.at(now);
  if (!motion.moving) return;
  GantryPosition to{dynamics_.destination()};
  const auto row = static_cast<Eigen::Index>(axis);
  double braking = 0;  // [s] of all of them together, as the dynamics have it
  for (std::size_t i = 0; i < rig_.gantry.model.axes.size(); ++i) {
    const double speed = std::abs(motion.velocity[static_cast<Eigen::Index>(i)]);
    braking = std::max(braking, speed / rig_.gantry.model.axes[i].max_acceleration);
  }
  to.axes[row] = motion.position[row] + motion.velocity[row] * (braking / 2);
  AxisValues left = to.axes - motion.position;
  left[row] = 0;
  if (left.cwiseAbs().maxCoeff() == 0) return halt_locked();
  gantry_commanded();
  const auto homing = [&](const auto& one) { return now < one.second; };
  const bool others_home =
      std::ranges::any_of(seeking_, homing) || (homed_from_ && now < *homed_from_);
  const auto own = seeking_.find(axis);
  if (own != seeking_.end() && homing(*own)) seeking_.erase(own);
  const TimePoint rest = dynamics_.move(now, to, others_home ? homing_speed_share : 1);
  for (auto& [other, until] : seeking_) until = until > now ? rest : until;
  if (homed_from_ && now < *homed_from_) homed_from_.reset();
}

Result<void> World::clear_fault() {
  const std::lock_guard lock(mutex_);
  if (!open_interlocks_.empty()) {
    return fail(ErrorCode::refused, fmt::format("interlock \"{}\" is still open: close it first",
                                                *open_interlocks_.begin()));
  }
  alarm_.clear();
  return {};
}

void World::lose_position() {
  const std::lock_guard lock(mutex_);
  halt_locked();
  homed_from_.reset();
  seeking_.clear();
}

GantryStatus World::gantry_status() const {
  const std::lock_guard lock(mutex_);
  const TimePoint now = clock_.now();
  const GantryMotionState motion = dynamics_.at(now);
  GantryStatus status;
  status.position.axes = motion.position;
  status.homed = homed_at(now);
  status.at_rest = !motion.moving;
  status.alarm = alarm_;
  status.open_interlocks.assign(open_interlocks_.begin(), open_interlocks_.end());
  return status;
}

void World::set_interlock(const std::string& name, bool open) {
  const std::lock_guard lock(mutex_);
  if (open) {
    halt_locked();
    open_interlocks_.insert(name);
  } else {
    open_interlocks_.erase(name);
  }
}

void World::raise_alarm(const std::string& text) {
  const std::lock_guard lock(mutex_);
  halt_locked();
  alarm_ = text;
}

void World::slip(std::size_t axis, double by) {
  const std::lock_guard lock(mutex_);
  AxisValues shift = AxisValues::Zero(static_cast<Eigen::Index>(rig_.gantry.model.axes.size()));
  shift[static_cast<Eigen::Index>(axis)] = by;
  dynamics_.displace(shift);
  if (homed_from_ && clock_.now() < *homed_from_) seek_home();
}

void World::set_lamp_gain(double gain) {
  const std::lock_guard lock(mutex_);
  lamp_gain_ = gain;
}

void World::set_temperatures(double lamp_c, double camera_c) {
  const std::lock_guard lock(mutex_);
  lamp_temperature_ = lamp_c;
  camera_temperature_ = camera_c;
}

void World::set_packet_weather(PacketWeather weather) {
  const std::lock_guard lock(mutex_);
  packet_weather_ = weather;
}

double World::lamp_temperature() const {
  const std::lock_guard lock(mutex_);
  return lamp_temperature_;
}

double World::camera_temperature() const {
  const std::lock_guard lock(mutex_);
  return camera_temperature_;
}

PacketWeather World::packet_weather() const {
  const std::lock_guard lock(mutex_);
  return packet_weather_;
}

// --- lamp

Result<void> World::set_lamp(double power) {
  if (auto set = switch_lamp(power); !set) return set;
  const std::lock_guard lock(mutex_);
  lamp_until_ = clock_.now() + rig_.lamp.max_on_time;
  return {};
}

Result<void> World::switch_lamp(double power) {
  const std::lock_guard lock(mutex_);
  if (!(power >= 0 && power <= rig_.lamp.max_power)) {
    return fail(ErrorCode::refused,
                fmt::format("lamp power {:.4g} is outside 0 to the rig's maximum of {:.4g}", power,
                            rig_.lamp.max_power));
  }
  lamp_power_ = power == 0 ? 0 : power;  // −0 would be another key for the same darkness
  lamp_until_ = TimePoint::max();
  return {};
}

double World::lamp_power() const {
  const std::lock_guard lock(mutex_);
  return clock_.now() < lamp_until_ ? lamp_power_ : 0;
}

}  // namespace lightrig::sim
