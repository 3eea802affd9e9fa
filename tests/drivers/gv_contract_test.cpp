// The contract of every camera, over real GVCP and GVSP; gantry and lamp of the same laboratory are
// in memory.
#include "sim/hosted_wire.h"
#include "tests/drivers/contract.h"
#include "tests/drivers/gv_camera_rig.h"

namespace lightrig {
namespace {

ContractSubject gige_vision() {
  ContractSubject subject;
  if (!backends().back().built) subject.absent = "Aravis is left out of this build";
  if (subject.absent.empty()) subject.absent = test::enter_own_network();
  if (!subject.absent.empty()) return subject;
  struct Far {
    RealClock clock;
    std::shared_ptr<sim::World> world;
    std::vector<sim::HostedWire> hosted;
  };
  auto far = std::make_shared<Far>();
  subject.rig = test::gv_rig();
  for (Axis& axis : subject.rig.gantry.model.axes) {
    axis.max_speed = 4;  // real seconds pass here
    axis.max_acceleration = 20;
  }
  sim::RenderOptions options;
  options.threads = 1;
  far->world = std::make_shared<sim::World>(subject.rig, make_sphere(0.05, 2), sim::lambert(0.5),
                                            far->clock, 1, options);
  const auto& backend = std::get<AravisCamera>(subject.rig.camera.backend);
  auto hosted = sim::host_wire(subject.rig, backend, far->world);
  EXPECT_TRUE(hosted) << hosted.error().message;
  far->hosted = std::move(*hosted);
  auto camera = open_camera(subject.rig, backend, far->clock);
  EXPECT_TRUE(camera) << camera.error().message;
  subject.clock = std::shared_ptr<Clock>(far, &far->clock);
  subject.devices.camera = std::move(*camera);
  subject.devices.gantry = sim::make_gantry(far->world);
  subject.devices.lamp = sim::make_lamp(far->world);
  subject.lamp_power_at_far_end = [world = far->world] { return world->lamp_power(); };
  subject.moving_at_far_end = [world = far->world] { return !world->gantry_status().at_rest; };
  subject.keep_alive = far;
  return subject;
}

INSTANTIATE_TEST_SUITE_P(Wire, DeviceContract,
                         testing::Values(ContractBackend{"GigEVision", gige_vision}),
                         [](const auto& backend) { return backend.param.name; });
INSTANTIATE_TEST_SUITE_P(Wire, DeviceContractInTime,
                         testing::Values(ContractBackend{"GigEVision", gige_vision}),
                         [](const auto& backend) { return backend.param.name; });

}  // namespace
}  // namespace lightrig
