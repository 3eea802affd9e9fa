#include "sim/world.h"

#include <fmt/format.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <numbers>

#include "core/check.h"
#include "sim/parallel.h"
#include "sim/sensor_noise.h"

namespace lightrig::sim {
namespace {

constexpr std::size_t most_records = 65536;
constexpr double homing_speed_share = 0.25;

// Kinds of randomness, so that no two share a key.
constexpr std::uint64_t noise_of_frame = 1, error_of_lamp = 2;

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

std::uint64_t content_of(const RawImage& image) {
  std::uint64_t hash = 0xcbf29ce484222325ULL;
  for (const std::uint16_t count : image.counts) {
    hash = (hash ^ (count & 0xffU)) * 0x100000001b3ULL;
    hash = (hash ^ (count >> 8U)) * 0x100000001b3ULL;
  }
  return hash;
}

World::World(const Rig& rig, Mesh object, Reflectance truth, Clock& clock, std::uint64_t seed,
             const RenderOptions& options)
    : rig_(rig),
      clock_(clock),
      seed_(seed),
      threads_(thread_count(options.threads)),
      render_options_(options),
      object_(std::move(object)),
      truth_(std::move(truth)),
      dynamics_(rig.gantry.model,
                ArmModel{rig.simulation->arm_frequency, rig.simulation->arm_damping},
                parked(rig.gantry.model), clock.now()),
      lamp_until_(clock.now()),
      opened_(clock.now()) {
  CHECK(rig.simulation.has_value());
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
  return *homed_from_;
}

Result<TimePoint> World::start_move(const GantryPosition& to) {
  const std::lock_guard lock(mutex_);
  if (auto allowed = may_move(); !allowed) return tl::unexpected(allowed.error());
  if (!homed_at(clock_.now())) {
    return fail(ErrorCode::refused, "the gantry does not know where it is: home it first");
  }
  if (const std::string beyond = beyond_limits(rig_.gantry.model, to); !beyond.empty()) {
    return fail(ErrorCode::refused, beyond);
  }
  gantry_commanded();
  return dynamics_.move(clock_.now(), to);
}

Result<TimePoint> World::start_axis_move(std::size_t axis, double to) {
  GantryPosition destination;
  {
    const std::lock_guard lock(mutex_);
    destination.axes = dynamics_.destination();
  }
  destination.axes[static_cast<Eigen::Index>(axis)] = to;
  return start_move(destination);
}

void World::halt_gantry() {
  const std::lock_guard lock(mutex_);
  const TimePoint now = clock_.now();
  if (homed_from_ && now < *homed_from_) homed_from_.reset();
  if (!dynamics_.at(now).moving) return;
  gantry_commanded();
  dynamics_.halt(now);
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
  halt_gantry();
  const std::lock_guard lock(mutex_);
  homed_from_.reset();
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
  if (open) halt_gantry();
  const std::lock_guard lock(mutex_);
  if (open) {
    open_interlocks_.insert(name);
  } else {
    open_interlocks_.erase(name);
  }
}

void World::raise_alarm(const std::string& text) {
  halt_gantry();
  const std::lock_guard lock(mutex_);
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

// --- camera

std::vector<std::uint64_t> World::position_words(const GantryPosition& drives) const {
  std::vector<std::uint64_t> words;
  for (const double value : drives.axes) {
    const std::int64_t steps = std::llround(value * 1e9);  // of a nanometre or nanoradian
    words.push_back(static_cast<std::uint64_t>(steps));
  }
  return words;
}

double arm_length_of(const DomeKinematics& dome) { return dome.radius; }
double arm_length_of(const TurntableKinematics& table) { return table.radius; }
double arm_length_of(const CartesianKinematics&) { return 0; }  // its lamp is never distant
double arm_length_of(const FixedLampsKinematics& fixed) {
  return (fixed.lamps.front() - fixed.centre).norm();
}

/// The lamp in the world. On a turntable it stands, and the object turns: written apart from
/// light_at(), which leaves the object and turns everything else.
LightPosition lamp_in_world(const GantryModel& gantry, const GantryPosition& position) {
  LightPosition light = light_at(gantry, position);
  if (const auto* table = std::get_if<TurntableKinematics>(&gantry.kinematics)) {
    const double e = table->arm ? position.axes[1] : table->elevation;
    const Eigen::Vector3d outwards(std::cos(e) * std::cos(table->azimuth),
                                   std::cos(e) * std::sin(table->azimuth), std::sin(e));
    light.p = light.distant ? outwards : Eigen::Vector3d(table->centre + table->radius * outwards);
    if (!light.lobe.uniform()) light.aim = -outwards;
  }
  return light;
}

/// A mesh turned about the vertical through a point.
Mesh turned_about(Mesh mesh, const Eigen::Vector3d& centre, double angle) {
  const double c = std::cos(angle), s = std::sin(angle);
  Eigen::Matrix3d turn;
  turn << c, -s, 0, s, c, 0, 0, 0, 1;
  mesh.vertices = (turn * (mesh.vertices.colwise() - centre)).colwise() + centre;
  mesh.normals = turn * mesh.normals;
  return mesh;
}

/// Where the lamp is: on the deflected arm, off by an error that is fixed for each position.
LightPosition World::true_light(const GantryMotionState& motion) const {
  const GantryModel& gantry = rig_.gantry.model;
  GantryPosition lamp;
  lamp.axes = motion.position + motion.deflection;
  LightPosition light = lamp_in_world(gantry, lamp);
  const double rms = rig_.simulation->lamp_position_error;
  if (rms <= 0) return light;
  GantryPosition drives;
  drives.axes = motion.position;
  std::vector<std::uint64_t> words = position_words(drives);
  words.push_back(error_of_lamp);
  const PhiloxKey key = derive_key(seed_, words);
  const Eigen::Vector3d error =
      Eigen::Vector3d(standard_normal(0, key), standard_normal(1, key), standard_normal(2, key)) *
      (rms / std::sqrt(3.0));
  if (!light.distant) {
    light.p += error;
  } else {
    // A distant lamp's error is the angle that the same error makes on the arm it stands for.
    const double arm_length = std::visit(
        [](const auto& kinematics) { return arm_length_of(kinematics); }, gantry.kinematics);
    if (arm_length > 0) light.p = (light.p + error / arm_length).normalized();
  }
  return light;
}

SceneMoment World::look() const {
  const std::lock_guard lock(mutex_);
  SceneMoment moment;
  moment.time = clock_.now();
  const GantryMotionState motion = dynamics_.at(moment.time);
  moment.drives.axes = motion.position;
  moment.moving = motion.moving;
  moment.light = true_light(motion);
  if (turns_object(rig_.gantry.model)) moment.turn = motion.position[0] + motion.deflection[0];
  moment.lamp_power = moment.time < lamp_until_ ? lamp_power_ : 0;
  const double open = std::chrono::duration<double>(moment.time - opened_).count();
  moment.lamp_gain = std::max(0.0, lamp_gain_ * (1 + rig_.simulation->lamp_drift * open));
  return moment;
}

/// The view of the object turned so far; made anew when a turntable has moved.
const Renderer& World::renderer_at(double turn) {
  if (!seen_ || seen_->first != turn) {
    const auto* table = std::get_if<TurntableKinematics>(&rig_.gantry.model.kinematics);
    CHECK(table != nullptr);
    seen_.emplace(turn, Renderer(turned_about(object_, table->centre, turn), rig_.camera.model,
                                 rig_.camera.sensor.filter, truth_, render_options_));
  }
  return seen_->second;
}

/// Radiance on the sites: the lamp's share is shaded once per lamp position and scaled.
Result<SiteRadiance> World::radiance_at(const SceneMoment& moment, const std::stop_token& stop) {
  const CameraModel& camera = rig_.camera.model;
  const auto sites =
      static_cast<std::size_t>(camera.width) * static_cast<std::size_t>(camera.height);
  SiteRadiance radiance(sites, 0.0F);
  if (moment.lamp_power > 0) {
    const std::lock_guard lock(render_mutex_);
    const bool known = shaded_ && shaded_->light.distant == moment.light.distant &&
                       shaded_->light.p == moment.light.p &&
                       shaded_->light.aim == moment.light.aim && shaded_->turn == moment.turn;
    if (!known) {
      auto image = renderer_at(moment.turn).render(moment.light, rig_.lamp.strength, stop);
      if (!image) return fail(ErrorCode::stopped, "the exposure was stopped");
      shaded_ = Shaded{moment.light, moment.turn, std::move(*image)};
      ++renders_;
    }
    const auto power = static_cast<float>(moment.lamp_power * moment.lamp_gain);
    std::transform(shaded_->radiance.begin(), shaded_->radiance.end(), radiance.begin(),
                   [power](float lit) { return power * lit; });
  }
  const Eigen::Array3d& ambient = rig_.simulation->ambient;
  if ((ambient > 0).any()) {
    std::size_t site = 0;
    for (int row = 0; row < camera.height; ++row) {
      for (int column = 0; column < camera.width; ++column, ++site) {
        const int channel = channel_at(rig_.camera.sensor.filter, row, column);
        radiance[site] += static_cast<float>(ambient[channel]);
      }
    }
  }
  return radiance;
}

Result<Frame> World::expose(const SceneMoment& moment, double exposure,
                            const std::stop_token& stop) {
  const SensorModel& sensor = rig_.camera.sensor;
  if (!(exposure >= sensor.min_exposure && exposure <= sensor.max_exposure)) {
    return fail(ErrorCode::refused,
                fmt::format("exposure {:.6g} s is outside the camera's {:.6g} to {:.6g} s",
                            exposure, sensor.min_exposure, sensor.max_exposure));
  }
  const Result<SiteRadiance> radiance = radiance_at(moment, stop);
  if (!radiance) return tl::unexpected(radiance.error());

  Frame frame;
  frame.exposure = exposure;
  std::vector<std::uint64_t> words = position_words(moment.drives);
  {
    const std::lock_guard lock(mutex_);
    const std::uint64_t repeat = requests_[{moment.lamp_power, exposure}]++;
    frame.id = ++frames_;
    records_.push_back({frame.id, exposure, repeat, moment, 0});
    if (records_.size() > most_records) records_.pop_front();
    words.insert(words.end(), {noise_of_frame, std::bit_cast<std::uint64_t>(moment.lamp_power),
                               std::bit_cast<std::uint64_t>(exposure), take_, repeat});
  }
  auto counts = expose_sensor(sensor, rig_.camera.model.width, rig_.camera.model.height, *radiance,
                              exposure, derive_key(seed_, words), threads_, stop);
  if (!counts) return fail(ErrorCode::stopped, "the exposure was stopped");
  frame.counts = std::move(*counts);
  const std::lock_guard lock(mutex_);
  for (auto record = records_.rbegin(); record != records_.rend(); ++record) {
    if (record->frame_id != frame.id) continue;
    record->content = content_of(frame.counts);
    break;
  }
  return frame;
}

void World::set_take(std::uint64_t take) {
  const std::lock_guard lock(mutex_);
  take_ = take;
}

std::vector<ExposureRecord> World::records() const {
  const std::lock_guard lock(mutex_);
  return {records_.begin(), records_.end()};
}

std::int64_t World::renders() const {
  const std::lock_guard lock(render_mutex_);
  return renders_;
}

}  // namespace lightrig::sim
