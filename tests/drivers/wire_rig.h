#pragma once

#include <gtest/gtest.h>
#include <unistd.h>

#include <chrono>
#include <functional>
#include <memory>
#include <stop_token>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "config/read_rig.h"
#include "drivers/backends.h"
#include "drivers/make_safe.h"
#include "sim/hosted_wire.h"
#include "sim/open_devices.h"
#include "sim/world.h"
#include "tests/drivers/own_network.h"
#include "tests/paths.h"

namespace lightrig::test {

/// The demo's rig with a small image and quick axes, so that a wire test takes a second.
inline Rig quick_rig() {
  auto read = read_rig(std::string(lightrig::test::source_dir) + "/config/demo.toml");
  for (const Diagnostic& diagnostic : read.diagnostics)
    if (diagnostic.severity == Diagnostic::Severity::error)
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

/// A quick rig, its gantry's backend, and the laboratory at the far end of its wires: what tests of
/// a driver against it share, whatever else their fixture is.
template <class Backend>
class WireLab {
 protected:
  /// The far ends of the rig as it is now; the lamp's too where it has a wire of its own.
  void host() {
    hosted_.clear();
    rig_.gantry.backend = backend_;
    world_ = world_of(rig_, clock_);
    add_far_end(backend_);
    if (const auto* lamp = std::get_if<ModbusLamp>(&rig_.lamp.backend)) add_far_end(*lamp);
  }

  Result<GantryAndLamp> open() { return open_gantry(rig_, backend_, clock_); }
  Until soon(std::chrono::milliseconds time) { return {clock_.now() + time, stop_.get_token()}; }
  /// Waits until it is so, for ten seconds at most: a loaded machine may take its time.
  template <class So>
  static bool comes_to_be(So so) {
    const auto end = std::chrono::steady_clock::now() + std::chrono::seconds(10);
    while (!so() && std::chrono::steady_clock::now() < end)
      std::this_thread::sleep_for(std::chrono::milliseconds(5));
    return so();
  }
  /// The drives have stopped.
  bool comes_to_rest() const {
    return comes_to_be([this] { return world_->gantry_status().at_rest; });
  }
  /// Does something this long after the drives have begun to move, on a thread of its own.
  std::jthread once_moving(std::chrono::milliseconds later, std::function<void()> then) const {
    return std::jthread([this, later, then = std::move(then)] {
      EXPECT_TRUE(comes_to_be([this] { return !world_->gantry_status().at_rest; }));
      std::this_thread::sleep_for(later);
      then();
    });
  }
  /// Asks every call made with soon() to stop, this long after the drives have begun to move.
  std::jthread stops_once_moving(std::chrono::milliseconds later) {
    return once_moving(later, [this] { stop_.request_stop(); });
  }

  /// What systemd runs once the service has died: nobody is left who holds the lamp's lease or the
  /// motion. The way home takes half a minute.
  void expect_made_safe_with_the_lamp_lit_and_the_arm_moving() {
    for (Axis& axis : rig_.gantry.model.axes) axis.max_speed = 0.2;
    ASSERT_NO_FATAL_FAILURE(host());
    ASSERT_TRUE(world_->start_homing());
    ASSERT_TRUE(world_->set_lamp(0.5));
    ASSERT_FALSE(world_->gantry_status().at_rest);
    const auto safe = make_safe(rig_, clock_);
    ASSERT_TRUE(safe) << safe.error().message;
    EXPECT_EQ(world_->lamp_power(), 0);
    EXPECT_TRUE(comes_to_rest());
    EXPECT_FALSE(world_->gantry_status().homed) << "it was stopped on the way, not left to arrive";
  }

  RealClock clock_;
  std::stop_source stop_;
  Rig rig_ = quick_rig();
  Backend backend_;
  std::shared_ptr<sim::World> world_;
  std::vector<sim::HostedWire> hosted_;

 private:
  template <class Part>
  void add_far_end(const Part& part) {
    auto wires = sim::host_wire(rig_, part, world_);
    ASSERT_TRUE(wires) << wires.error().message;
    for (sim::HostedWire& wire : *wires) hosted_.push_back(std::move(wire));
  }
};

enum class ModbusWireKind { tcp, rtu };

/// The same for drives on Modbus, over TCP or over one serial line.
class ModbusLab : public WireLab<ModbusGantry> {
 protected:
  ModbusLab() { backend_ = std::get<ModbusGantry>(rig_.gantry.backend); }
  void connect(const std::variant<TcpEndpoint, SerialEndpoint>& endpoint) {
    for (ModbusDrive& drive : backend_.drives) drive.endpoint = endpoint;
    rig_.gantry.backend = backend_;
  }
  /// Over Modbus TCP on a network of its own, or over a pty. Returns what stands in the way, empty
  /// if nothing.
  std::string connect_by(ModbusWireKind kind) {
    if (!backends().front().built) return "Modbus is left out of this build";
    if (std::string obstacle = enter_own_network(); !obstacle.empty()) return obstacle;
    backend_.timeout = std::chrono::milliseconds(200);
    serial_.device = testing::TempDir() + "lightrig_modbus_" + std::to_string(getpid());
    if (kind == ModbusWireKind::tcp) {
      connect(TcpEndpoint{"127.0.0.1", 1502});
    } else {
      connect(serial_);
    }
    return "";
  }

  SerialEndpoint serial_;
};

}  // namespace lightrig::test
