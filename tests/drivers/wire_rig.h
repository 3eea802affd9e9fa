#pragma once

#include <gtest/gtest.h>

#include <memory>
#include <string>
#include <vector>

#include "config/read_rig.h"
#include "drivers/backends.h"
#include "sim/hosted_wire.h"
#include "sim/open_devices.h"
#include "sim/world.h"
#include "tests/paths.h"

namespace lightrig::test {

/// The demo's rig with a small image and quick axes, so that a wire test takes a second.
inline Rig quick_rig() {
  auto read = read_rig(std::string(lightrig::test::source_dir) + "/config/demo.toml");
  for (const Diagnostic& diagnostic : read.diagnostics)
    ADD_FAILURE() << to_text(diagnostic, read.text);
  Rig rig = *read.value;
  rig.camera.model.width = 32;
  rig.camera.model.height = 24;
  for (Axis& axis : rig.gantry.model.axes) {
    axis.max_speed = 6;
    axis.max_acceleration = 30;
  }
  rig.session_defaults.object.shape = "sphere";
  return rig;
}

inline std::shared_ptr<sim::World> world_of(const Rig& rig, Clock& clock) {
  auto world = sim::make_world(rig, rig.session_defaults.object, clock, 1);
  EXPECT_TRUE(world) << world.error().message;
  return *world;
}

inline GantryPosition at_degrees(double azimuth, double elevation) {
  GantryPosition position;
  position.axes.resize(2);
  position.axes << azimuth * 0.017453292519943295, elevation * 0.017453292519943295;
  return position;
}

}  // namespace lightrig::test
