// Where the lamp really is, and what the laboratory looks like at a moment.
#include <algorithm>
#include <cmath>
#include <variant>

#include "sim/world.h"
#include "sim/world_noise.h"

namespace lightrig::sim {
namespace {

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

}  // namespace

std::vector<std::uint64_t> World::position_words(const GantryPosition& drives) const {
  std::vector<std::uint64_t> words;
  for (const double value : drives.axes) {
    const std::int64_t steps = std::llround(value * 1e9);  // of a nanometre or nanoradian
    words.push_back(static_cast<std::uint64_t>(steps));
  }
  return words;
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

}  // namespace lightrig::sim
