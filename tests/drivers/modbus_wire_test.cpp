// The Modbus gantry against a simulated controller over real TCP and over a pty, and against
// independent peers.
#include <gtest/gtest.h>

#include <chrono>
#include <thread>

#include "tests/drivers/own_network.h"
#include "tests/drivers/wire_rig.h"

namespace lightrig {
namespace {

using namespace std::chrono_literals;

using Wire = test::ModbusWireKind;

class ModbusWire : public testing::TestWithParam<Wire>, protected test::ModbusLab {
 protected:
  void SetUp() override {
    if (const std::string obstacle = connect_by(GetParam()); !obstacle.empty())
      GTEST_SKIP() << obstacle;
    ASSERT_NO_FATAL_FAILURE(host());
    ASSERT_EQ(hosted_.size(), 1U) << "two drives on one wire are units of one server";
  }
};

/// A lamp beside the drives, on a wire of its own: one kind is enough, the registers are the same.
class ModbusLampUnit : public ModbusWire {};

TEST_P(ModbusLampUnit, IsDimmedReadBackAndTellsItsTemperature) {
  ModbusLamp lamp;
  lamp.endpoint = TcpEndpoint{"127.0.0.1", 1503};
  lamp.holding = 0x20;
  lamp.full_scale = 1000;
  lamp.temperature = 0x21;
  lamp.degrees_per_count = 0.1;
  rig_.lamp.backend = lamp;
  ASSERT_NO_FATAL_FAILURE(host());
  auto opened = open_lamp(rig_, lamp, clock_);
  ASSERT_TRUE(opened) << opened.error().message;
  for (const double celsius : {47.3, -12.5}) {  // below zero the count is negative
    world_->set_temperatures(celsius, 25);
    ASSERT_TRUE((*opened)->set(0.4, soon(2s)));
    const auto state = (*opened)->state(soon(2s));
    ASSERT_TRUE(state) << state.error().message;
    EXPECT_DOUBLE_EQ(state->power, 0.4);
    EXPECT_DOUBLE_EQ(world_->lamp_power(), 0.4);
    EXPECT_NEAR(state->temperature_c.value(), celsius, 1e-9);
  }
  opened->reset();
  EXPECT_EQ(world_->lamp_power(), 0);
}

TEST_P(ModbusWire, HomesMovesAndReadsItsPositionBack) {
  auto opened = open();
  ASSERT_TRUE(opened) << opened.error().message;
  Gantry& gantry = *opened->gantry;
  const auto unhomed = gantry.status(soon(2s));
  ASSERT_TRUE(unhomed) << unhomed.error().message;
  EXPECT_FALSE(unhomed->homed);
  const auto homed = gantry.home(soon(20s));
  ASSERT_TRUE(homed) << homed.error().message;
  for (const auto& target :
       {test::at_degrees(40, 50), test::at_degrees(-60, 20), test::at_degrees(-60, 20)}) {
    const auto moved = gantry.move_to(target, soon(10s));
    ASSERT_TRUE(moved) << moved.error().message;
    const auto status = gantry.status(soon(2s));
    ASSERT_TRUE(status) << status.error().message;
    EXPECT_TRUE(status->homed);
    EXPECT_TRUE(status->at_rest);
    EXPECT_LE((status->position.axes - target.axes).cwiseAbs().maxCoeff(),
              rig_.gantry.model.tolerance);
    // The world itself, not the registers, says where the drives are.
    EXPECT_LE((world_->gantry_status().position.axes - target.axes).cwiseAbs().maxCoeff(),
              rig_.gantry.model.tolerance);
  }
}

TEST_P(ModbusWire, RefusesToMoveBeforeHomingAndBeyondItsTravel) {
  auto opened = open();
  ASSERT_TRUE(opened) << opened.error().message;
  const auto unhomed = opened->gantry->move_to(test::at_degrees(10, 30), soon(5s));
  ASSERT_FALSE(unhomed);
  EXPECT_EQ(unhomed.error().code, ErrorCode::refused) << unhomed.error().message;
  const auto beyond = opened->gantry->move_to(test::at_degrees(300, 30), soon(5s));
  ASSERT_FALSE(beyond);
  EXPECT_EQ(beyond.error().code, ErrorCode::refused);
}

TEST_P(ModbusWire, AStopRequestReturnsAtOnceAndTheDrivesComeToRest) {
  rig_.gantry.model.axes[0].max_speed = 1;  // the driver plans a slow move …
  auto opened = open();
  ASSERT_TRUE(opened) << opened.error().message;
  ASSERT_TRUE(opened->gantry->home(soon(20s)));
  const std::jthread stopper = stops_once_moving(100ms);
  const auto target = test::at_degrees(150, 80);
  const auto moved = opened->gantry->move_to(target, soon(30s));
  ASSERT_FALSE(moved);
  EXPECT_EQ(moved.error().code, ErrorCode::stopped) << moved.error().message;
  EXPECT_TRUE(comes_to_rest());
  EXPECT_GT((world_->gantry_status().position.axes - target.axes).cwiseAbs().maxCoeff(), 0.1);
}

TEST_P(ModbusWire, AnOpenDoorEndsTheMoveWithItsName) {
  auto opened = open();
  ASSERT_TRUE(opened) << opened.error().message;
  ASSERT_TRUE(opened->gantry->home(soon(20s)));
  const std::jthread opener = once_moving(50ms, [this] { world_->set_interlock("door", true); });
  const auto moved = opened->gantry->move_to(test::at_degrees(150, 80), soon(30s));
  ASSERT_FALSE(moved);
  EXPECT_NE(moved.error().message.find("door"), std::string::npos) << moved.error().message;
}

TEST_P(ModbusWire, TheLampOnTheControllersOutputGoesDarkWithItsOwner) {
  auto opened = open();
  ASSERT_TRUE(opened) << opened.error().message;
  ASSERT_TRUE(opened->lamp);
  ASSERT_TRUE(opened->lamp->set(1, soon(2s)));
  EXPECT_EQ(world_->lamp_power(), 1.0);
  const auto state = opened->lamp->state(soon(2s));
  ASSERT_TRUE(state);
  EXPECT_TRUE(state->confirmed);
  EXPECT_EQ(state->power, 1.0);
  opened->lamp.reset();
  EXPECT_EQ(world_->lamp_power(), 0.0);
}

TEST_P(ModbusWire, AWireThatIsGoneIsSaidToBeGoneInTime) {
  auto opened = open();
  ASSERT_TRUE(opened) << opened.error().message;
  ASSERT_TRUE(opened->gantry->home(soon(20s)));
  hosted_.clear();
  const auto begin = std::chrono::steady_clock::now();
  const auto status = opened->gantry->status(soon(5s));
  ASSERT_FALSE(status);
  EXPECT_LT(std::chrono::steady_clock::now() - begin, 5s);
  EXPECT_NE(status.error().message.find("modbus"), std::string::npos) << status.error().message;
}

// Found: "Address already in use", and nothing on what to do.
TEST_P(ModbusLampUnit, IsNotHostedWhereAnotherListensAndItIsSaidWhatToDo) {
  const auto second = sim::host_wire(rig_, backend_, world_);
  ASSERT_FALSE(second);
  EXPECT_NE(second.error().message.find("listen at 127.0.0.1:1502"), std::string::npos);
  EXPECT_NE(second.error().message.find("another program has that port"), std::string::npos)
      << second.error().message;
}

std::string wire_name(const testing::TestParamInfo<Wire>& wire) {
  return wire.param == Wire::tcp ? "Tcp" : "Rtu";
}

INSTANTIATE_TEST_SUITE_P(Wires, ModbusLampUnit, testing::Values(Wire::tcp), wire_name);
INSTANTIATE_TEST_SUITE_P(Wires, ModbusWire, testing::Values(Wire::tcp, Wire::rtu), wire_name);

}  // namespace
}  // namespace lightrig
