// The Modbus gantry against a simulated controller over real TCP and over a pty, and against
// independent peers.
#include <gtest/gtest.h>

#include <chrono>
#include <filesystem>
#include <thread>

#include "drivers/make_safe.h"
#include "tests/drivers/own_network.h"
#include "tests/drivers/wire_rig.h"

namespace lightrig {
namespace {

using namespace std::chrono_literals;

enum class Wire { tcp, rtu };

class ModbusWire : public testing::TestWithParam<Wire> {
 protected:
  void SetUp() override {
    if (!backends().front().built) GTEST_SKIP() << "Modbus is left out of this build";
    const std::string obstacle = test::enter_own_network();
    if (!obstacle.empty()) GTEST_SKIP() << obstacle;
    rig_ = test::quick_rig();
    backend_ = std::get<ModbusGantry>(rig_.gantry.backend);
    backend_.timeout = 200ms;
    pty_ = testing::TempDir() + "lightrig_modbus_" + std::to_string(getpid());
    for (ModbusDrive& drive : backend_.drives) {
      if (GetParam() == Wire::tcp) {
        drive.endpoint = TcpEndpoint{"127.0.0.1", 1502};
      } else {
        SerialEndpoint serial;
        serial.device = pty_;
        drive.endpoint = serial;
      }
    }
    rig_.gantry.backend = backend_;
    world_ = test::world_of(rig_, clock_);
    auto hosted = sim::host_wire(rig_, backend_, world_);
    ASSERT_TRUE(hosted) << hosted.error().message;
    hosted_ = std::move(*hosted);
    ASSERT_EQ(hosted_.size(), 1U) << "two drives on one wire are units of one server";
  }

  Result<GantryAndLamp> open() { return open_gantry(rig_, backend_, clock_); }
  Until soon(std::chrono::milliseconds time) { return {clock_.now() + time, stop_.get_token()}; }

  RealClock clock_;
  std::stop_source stop_;
  Rig rig_;
  ModbusGantry backend_;
  std::string pty_;
  std::shared_ptr<sim::World> world_;
  std::vector<sim::HostedWire> hosted_;
};

TEST_P(ModbusWire, ALampOfItsOwnUnitIsDimmedReadBackAndTellsItsTemperature) {
  if (GetParam() != Wire::tcp) GTEST_SKIP() << "one wire is enough: the registers are the same";
  ModbusLamp lamp;
  lamp.endpoint = TcpEndpoint{"127.0.0.1", 1503};
  lamp.holding = 0x20;
  lamp.full_scale = 1000;
  lamp.temperature = 0x21;
  lamp.degrees_per_count = 0.1;
  rig_.lamp.backend = lamp;
  auto wires = sim::host_wire(rig_, lamp, world_);
  ASSERT_TRUE(wires) << wires.error().message;
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

// What systemd runs once the service has died: nobody is left who holds the lamp's lease or the
// motion.
TEST_P(ModbusWire, IsMadeSafeAfterItsProgramDiedWithTheLampLitAndTheArmMoving) {
  hosted_.clear();
  for (Axis& axis : rig_.gantry.model.axes)
    axis.max_speed = 0.2;  // the way home takes half a minute
  world_ = test::world_of(rig_, clock_);
  auto hosted = sim::host_wire(rig_, backend_, world_);
  ASSERT_TRUE(hosted) << hosted.error().message;
  hosted_ = std::move(*hosted);
  ASSERT_TRUE(world_->start_homing());
  ASSERT_TRUE(world_->set_lamp(0.5));
  ASSERT_FALSE(world_->gantry_status().at_rest);
  const auto safe = make_safe(rig_, clock_);
  ASSERT_TRUE(safe) << safe.error().message;
  EXPECT_EQ(world_->lamp_power(), 0);
  for (int i = 0; i < 200 && !world_->gantry_status().at_rest; ++i)
    std::this_thread::sleep_for(10ms);
  EXPECT_TRUE(world_->gantry_status().at_rest);
  EXPECT_FALSE(world_->gantry_status().homed) << "it was stopped on the way, not left to arrive";
}

TEST_P(ModbusWire, ALampOfItsOwnWireIsMadeDarkThoughTheGantryIsGoneAndIsSaidToBeOnWhereItIsGone) {
  if (GetParam() != Wire::tcp) GTEST_SKIP() << "one wire is enough: the lamp's is another";
  ModbusLamp lamp;
  lamp.endpoint = TcpEndpoint{"127.0.0.1", 1503};
  lamp.coil = 3;
  rig_.lamp.backend = lamp;
  auto wire = sim::host_wire(rig_, lamp, world_);
  ASSERT_TRUE(wire) << wire.error().message;
  hosted_.clear();
  ASSERT_TRUE(world_->set_lamp(0.5));
  auto safe = make_safe(rig_, clock_);
  ASSERT_FALSE(safe);
  EXPECT_EQ(world_->lamp_power(), 0);
  EXPECT_NE(safe.error().message.find("the lamp is dark, the gantry may be moving"),
            std::string::npos)
      << safe.error().message;
  wire->clear();
  safe = make_safe(rig_, clock_);
  ASSERT_FALSE(safe);
  EXPECT_NE(safe.error().message.find("LAMP MAY BE ON"), std::string::npos) << safe.error().message;
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
  std::jthread stopper([&] {
    std::this_thread::sleep_for(150ms);
    stop_.request_stop();
  });
  const auto target = test::at_degrees(150, 80);
  const auto moved = opened->gantry->move_to(target, soon(30s));
  ASSERT_FALSE(moved);
  EXPECT_EQ(moved.error().code, ErrorCode::stopped) << moved.error().message;
  std::this_thread::sleep_for(1s);
  EXPECT_TRUE(world_->gantry_status().at_rest);
  EXPECT_GT((world_->gantry_status().position.axes - target.axes).cwiseAbs().maxCoeff(), 0.1);
}

TEST_P(ModbusWire, AnOpenDoorEndsTheMoveWithItsName) {
  auto opened = open();
  ASSERT_TRUE(opened) << opened.error().message;
  ASSERT_TRUE(opened->gantry->home(soon(20s)));
  std::jthread opener([&] {
    std::this_thread::sleep_for(100ms);
    world_->set_interlock("door", true);
  });
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

std::string wire_name(const testing::TestParamInfo<Wire>& wire) {
  return wire.param == Wire::tcp ? "Tcp" : "Rtu";
}

INSTANTIATE_TEST_SUITE_P(Wires, ModbusWire, testing::Values(Wire::tcp, Wire::rtu), wire_name);

}  // namespace
}  // namespace lightrig
