#pragma once

#include <cmath>
#include <limits>
#include <memory>
#include <numbers>

#include "config/rig.h"
#include "core/shapes.h"
#include "sim/memory_devices.h"
#include "sim/sim_clock.h"
#include "sim/world.h"

namespace lightrig::sim {

/// A small rig, written by hand: a 64 × 48 camera over a sphere, a dome with a springy arm.
inline Rig lab_rig() {
  constexpr double pi = std::numbers::pi;
  Rig rig;
  rig.name = "lab";
  CameraModel& camera = rig.camera.model;
  camera.width = 64;
  camera.height = 48;
  camera.fx = camera.fy = 250;
  camera.cx = 31.5;
  camera.cy = 23.5;
  camera.camera_from_world = look_at({0, -0.6, 0.4}, {0, 0, 0}, Eigen::Vector3d::UnitZ());
  SensorModel& sensor = rig.camera.sensor;
  sensor.bits = 12;
  sensor.gain = 2.5;
  sensor.black_level = 64;
  sensor.read_noise = 5;
  sensor.dark_current = 2;
  sensor.full_well = 10000;
  sensor.response = Eigen::Array3d::Constant(2000);
  sensor.min_exposure = 1e-4;
  sensor.max_exposure = 10;
  rig.camera.readout_time = 0.02;
  GantryModel& gantry = rig.gantry.model;
  gantry.kinematics = DomeKinematics{Eigen::Vector3d::Zero(), 0.5};
  gantry.axes = {{"azimuth", true, -pi, pi, 0.8, 1.6, 0.1},
                 {"elevation", true, 0, 1.5, 0.5, 1.0, 0.2}};
  gantry.settle_time = 1;
  gantry.tolerance = 1e-4;
  rig.lamp.strength = Eigen::Array3d::Constant(2.0);
  rig.lamp.max_power = 0.9;
  rig.lamp.power = 0.8;
  rig.lamp.max_on_time = std::chrono::minutes(10);
  rig.interlocks = {{"door", "in1", false}};
  rig.simulation.emplace();
  rig.simulation->material = "lambert";
  rig.simulation->arm_frequency = 2;
  rig.simulation->arm_damping = 0.2;
  return rig;
}

inline Reflectance lambert(double albedo) {
  return [albedo](const HalfDiff&) -> Eigen::Array3d {
    return Eigen::Array3d::Constant(albedo / std::numbers::pi);
  };
}

inline GantryPosition dome_position(double azimuth, double elevation) {
  GantryPosition position;
  position.axes = Eigen::Vector2d(azimuth, elevation);
  return position;
}

/// A world of that rig with its clock and devices, in the order they may be destroyed.
struct Lab {
  explicit Lab(const Rig& rig, std::uint64_t seed = 1,
               double clock_rate = std::numeric_limits<double>::infinity(), int threads = 2)
      : clock(make_clock(clock_rate)) {
    RenderOptions options;
    options.threads = threads;
    options.seed = seed;
    world = std::make_shared<World>(rig, make_sphere(0.05, 2), lambert(0.5), *clock, seed, options);
    devices.camera = make_camera(world);
    devices.gantry = make_gantry(world);
    devices.lamp = make_lamp(world);
  }

  Until within(double s) const {
    return {clock->now() + std::chrono::nanoseconds(std::llround(s * 1e9)), {}};
  }
  void wait(double s) { clock->sleep_until(within(s).deadline, {}); }

  std::unique_ptr<Clock> clock;
  std::shared_ptr<World> world;
  Devices devices;
};

}  // namespace lightrig::sim
