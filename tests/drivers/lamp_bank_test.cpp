// Fixed lamps on coils against an independent Modbus server (pymodbus), and against the laboratory.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <chrono>
#include <thread>

#include "drivers/backends.h"
#include "tests/drivers/child_process.h"
#include "tests/drivers/own_network.h"
#include "tests/drivers/wire_rig.h"

namespace lightrig {
namespace {

using namespace std::chrono_literals;

constexpr const char* server = R"(
from pymodbus.server import StartTcpServer
from pymodbus.datastore import ModbusSequentialDataBlock, ModbusSlaveContext, ModbusServerContext
coils = ModbusSequentialDataBlock(0, [0] * 64)
StartTcpServer(context=ModbusServerContext(slaves=ModbusSlaveContext(co=coils), single=True), address=("127.0.0.1", 1503))
)";

class LampBankWire : public testing::Test {
 protected:
  void SetUp() override {
    if (!backends().front().built) GTEST_SKIP() << "Modbus is left out of this build";
    const std::string obstacle = test::enter_own_network();
    if (!obstacle.empty()) GTEST_SKIP() << obstacle;
    peer_ = std::make_unique<test::ChildProcess>(
        std::vector<std::string>{"/usr/bin/python3", "-c", server});
    rig_.gantry.model.kinematics =
        FixedLampsKinematics{{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}, Eigen::Vector3d::Zero()};
    rig_.gantry.model.axes = {{"lamp", false, 0, 2, 1, 1, 0, true}};
    rig_.gantry.backend = FixedLampsGantry{};
    rig_.lamp.backend = wires();
    rig_.lamp.max_power = 1;
  }

  static ModbusLamp wires() {
    ModbusLamp lamp;
    lamp.endpoint = TcpEndpoint{"127.0.0.1", 1503};
    lamp.coil = 4;
    lamp.timeout = 500ms;
    return lamp;
  }

  // The server needs a moment to listen.
  Result<GantryAndLamp> open() {
    for (int attempt = 0; attempt < 100; ++attempt) {
      auto opened = open_gantry(rig_, FixedLampsGantry{}, clock_);
      if (opened || !peer_->running()) return opened;
      std::this_thread::sleep_for(100ms);
    }
    return open_gantry(rig_, FixedLampsGantry{}, clock_);
  }

  /// Whether the lamp on this coil is the one that burns, as read back.
  bool burns(int coil) {
    const auto status = bank_->gantry->status(soon());
    EXPECT_TRUE(status) << status.error().message;
    const auto state = bank_->lamp->state(soon());
    EXPECT_TRUE(state) << state.error().message;
    return status && state && state->power > 0 &&
           4 + static_cast<int>(status->position.axes[0]) == coil;
  }
  Until soon() { return {clock_.now() + 3s, {}}; }
  static GantryPosition lamp(double number) {
    GantryPosition position;
    position.axes = Eigen::Matrix<double, 1, 1>(number);
    return position;
  }

  RealClock clock_;
  Rig rig_;
  std::unique_ptr<test::ChildProcess> peer_;
  std::optional<GantryAndLamp> bank_;
};

TEST_F(LampBankWire, LightsTheChosenLampAloneAndIsDarkWhileChoosing) {
  auto opened = open();
  ASSERT_TRUE(opened) << opened.error().message;
  bank_ = std::move(*opened);
  Gantry& gantry = *bank_->gantry;
  Lamp& light = *bank_->lamp;
  const auto unhomed = gantry.move_to(lamp(1), soon());
  EXPECT_FALSE(unhomed);
  ASSERT_TRUE(gantry.home(soon()));
  ASSERT_TRUE(gantry.move_to(lamp(2), soon()));
  ASSERT_TRUE(light.set(1, soon()));
  EXPECT_TRUE(burns(6));
  const auto status = gantry.status(soon());
  ASSERT_TRUE(status);
  EXPECT_EQ(status->alarm, "");  // no other lamp burns
  ASSERT_TRUE(gantry.move_to(lamp(0), soon()));
  EXPECT_EQ(light.state(soon())->power, 0);  // it went dark by itself
  ASSERT_TRUE(light.set(1, soon()));
  EXPECT_TRUE(burns(4));
  EXPECT_FALSE(light.set(1.5, soon()));  // beyond the rig's maximum
  ASSERT_TRUE(light.set(0, soon()));
  EXPECT_EQ(light.state(soon())->power, 0);
  EXPECT_FALSE(gantry.move_to(lamp(3), soon()));
  EXPECT_FALSE(gantry.move_to(lamp(0.5), soon()));
}

TEST_F(LampBankWire, APulledWireIsDisconnectedAndNotDark) {
  auto opened = open();
  ASSERT_TRUE(opened) << opened.error().message;
  ASSERT_TRUE(opened->gantry->home(soon()));
  peer_->end();
  EXPECT_FALSE(opened->lamp->set(1, soon()));
  EXPECT_FALSE(opened->gantry->status(soon()));
}

TEST_F(LampBankWire, ASimulatedFarEndLightsTheObjectFromTheChosenLamp) {
  Rig rig = test::quick_rig();
  rig.gantry.model.kinematics = std::get<FixedLampsKinematics>(rig_.gantry.model.kinematics);
  rig.gantry.model.axes = rig_.gantry.model.axes;
  rig.gantry.backend = FixedLampsGantry{};
  ModbusLamp lamps = wires();
  lamps.endpoint = TcpEndpoint{"127.0.0.1", 1504};
  rig.lamp.backend = lamps;
  const auto world = test::world_of(rig, clock_);
  auto hosted = sim::host_wire(rig, lamps, world, nullptr);
  ASSERT_TRUE(hosted) << hosted.error().message;
  auto opened = open_gantry(rig, FixedLampsGantry{}, clock_);
  ASSERT_TRUE(opened) << opened.error().message;
  ASSERT_TRUE(opened->gantry->home(soon()));
  for (const int number : {2, 0, 1}) {
    ASSERT_TRUE(opened->gantry->move_to(lamp(number), soon()));
    EXPECT_EQ(world->look().lamp_power, 0);  // dark while choosing
    ASSERT_TRUE(opened->lamp->set(1, soon()));
    const sim::SceneMoment moment = world->look();
    EXPECT_GT(moment.lamp_power, 0);
    EXPECT_NEAR(moment.light.p[number], 1, 0.01);
    EXPECT_EQ(opened->lamp->state(soon())->power, 1);
  }
}

}  // namespace
}  // namespace lightrig
