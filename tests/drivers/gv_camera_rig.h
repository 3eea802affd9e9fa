#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <memory>
#include <string>

#include "drivers/backends.h"
#include "sim/camera_wire_faults.h"
#include "sim/hosted_wire.h"
#include "sim/world.h"
#include "tests/drivers/own_network.h"
#include "tests/sim/lab_rig.h"

namespace lightrig::test {

/// The kernel's ceiling on UDP receive buffers: a rig file that asks for more is refused. What it
/// grants is half of what it says [socket(7)].
inline int receive_ceiling() {
  const int probe = socket(AF_INET, SOCK_DGRAM, 0);
  const int more_than_any = 1 << 29;
  int granted = 0;
  socklen_t size = sizeof granted;
  setsockopt(probe, SOL_SOCKET, SO_RCVBUF, &more_than_any, sizeof more_than_any);
  getsockopt(probe, SOL_SOCKET, SO_RCVBUF, &granted, &size);
  close(probe);
  return granted / 2;
}

/// The small laboratory whose camera is reached by GigE Vision.
inline Rig gv_rig() {
  Rig rig = sim::lab_rig();
  AravisCamera camera;
  camera.id = "127.0.0.1";
  camera.socket_buffer_bytes = std::min(receive_ceiling(), 4 << 20);
  rig.camera.backend = camera;
  rig.camera.sensor.min_exposure = 1e-4;
  rig.camera.sensor.max_exposure = 2;
  rig.camera.readout_time = 0.005;
  return rig;
}

/// A laboratory in a network of its own, whose camera is hosted there: our driver, or anybody
/// else's, meets it at 127.0.0.1.
class GvCameraTest : public testing::Test {
 protected:
  void SetUp() override {
    if (!backends().back().built) GTEST_SKIP() << "Aravis is left out of this build";
    const std::string obstacle = enter_own_network();
    if (!obstacle.empty()) GTEST_SKIP() << obstacle;
    host(gv_rig());
  }

  void host(const Rig& rig) {
    hosted_.clear();
    rig_ = rig;
    sim::RenderOptions options;
    options.threads = 1;
    world_ = std::make_shared<sim::World>(rig_, make_sphere(0.05, 2), sim::lambert(0.5), clock_, 1,
                                          options);
    faults_ = std::make_shared<sim::CameraWireFaults>();
    auto hosted = sim::host_wire(rig_, backend(), world_, faults_);
    ASSERT_TRUE(hosted) << hosted.error().message;
    hosted_ = std::move(*hosted);
  }

  AravisCamera& backend() { return std::get<AravisCamera>(rig_.camera.backend); }
  Result<std::unique_ptr<Camera>> open() { return open_camera(rig_, backend(), clock_); }
  Until soon(double seconds) const {
    return {clock_.now() + std::chrono::nanoseconds(std::llround(seconds * 1e9)), {}};
  }
  /// What the laboratory itself recorded of the last frame it rendered.
  sim::ExposureRecord last_record() const { return world_->records().back(); }

  RealClock clock_;
  Rig rig_;
  std::shared_ptr<sim::World> world_;
  std::shared_ptr<sim::CameraWireFaults> faults_;
  std::vector<sim::HostedWire> hosted_;
};

}  // namespace lightrig::test
