// What the Modbus gantry does so that nothing moves or burns that should not: made safe after its
// program died, no move from a drive that moves, is not enabled or not in position.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <chrono>
#include <thread>

#include "drivers/modbus/modbus_bus.h"
#include "tests/drivers/own_network.h"
#include "tests/drivers/wire_rig.h"

namespace lightrig {
namespace {

using namespace std::chrono_literals;
using testing::HasSubstr;

enum class Wire { tcp, rtu };

class ModbusSafety : public testing::TestWithParam<Wire>, protected test::ModbusLab {
 protected:
  void SetUp() override {
    if (!backends().front().built) GTEST_SKIP() << "Modbus is left out of this build";
    const std::string obstacle = test::enter_own_network();
    if (!obstacle.empty()) GTEST_SKIP() << obstacle;
    backend_.timeout = 200ms;
    serial_.device = testing::TempDir() + "lightrig_safety_" + std::to_string(getpid());
    if (GetParam() == Wire::tcp)
      connect(TcpEndpoint{"127.0.0.1", 1502});
    else
      connect(serial_);
  }

  ModbusLamp lamp_beside_the_drives() const {
    ModbusLamp lamp;
    lamp.endpoint = backend_.drives.front().endpoint;
    lamp.unit = 9;
    lamp.coil = 3;
    return lamp;
  }
  /// Drives that say only whether they are in position.
  void say_no_more_than_in_position() {
    backend_.controller.moving.reset();
    backend_.controller.done.must_see_busy = false;
  }

  SerialEndpoint serial_;
};

// Without a watchdog in the drives nobody else would stop them.
TEST_P(ModbusSafety, DrivesWithoutAWatchdogAreMadeSafeAfterTheirProgramDied) {
  backend_.controller.watchdog.reset();
  expect_made_safe_with_the_lamp_lit_and_the_arm_moving();
}

TEST_P(ModbusSafety, AGantryAndALampOnTheSameWireAreBothMadeSafe) {
  backend_.controller.watchdog.reset();
  rig_.lamp.backend = lamp_beside_the_drives();
  expect_made_safe_with_the_lamp_lit_and_the_arm_moving();
}

TEST_P(ModbusSafety, ADeadDriveKeepsNeitherTheOtherMovingNorTheLampLit) {
  backend_.controller.watchdog.reset();
  rig_.lamp.backend = lamp_beside_the_drives();
  for (Axis& axis : rig_.gantry.model.axes) axis.max_speed = 0.2;
  ASSERT_NO_FATAL_FAILURE(host());
  ASSERT_TRUE(world_->start_homing());
  ASSERT_TRUE(world_->set_lamp(0.5));
  backend_.drives[1].unit = 77;  // nobody answers to it
  rig_.gantry.backend = backend_;
  const auto safe = make_safe(rig_, clock_);
  ASSERT_FALSE(safe);
  EXPECT_THAT(safe.error().message, HasSubstr("the lamp is dark, the gantry may be moving"));
  EXPECT_EQ(world_->lamp_power(), 0);
  EXPECT_TRUE(comes_to_rest()) << "the drive that answers was told to stop";
}

TEST_P(ModbusSafety, EveryLampOfABankIsMadeDark) {
  Rig bank = rig_;
  bank.gantry.model.kinematics =
      FixedLampsKinematics{{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}, Eigen::Vector3d::Zero()};
  bank.gantry.model.axes = {{"lamp", false, 0, 2, 1, 1, 0, true}};
  bank.gantry.backend = FixedLampsGantry{};
  bank.lamp.max_power = bank.lamp.power = 1;
  const ModbusLamp lamps = lamp_beside_the_drives();
  bank.lamp.backend = lamps;
  world_ = test::world_of(bank, clock_);
  auto wires = sim::host_wire(bank, lamps, world_);
  ASSERT_TRUE(wires) << wires.error().message;
  {
    auto abandoned = ModbusBus::open(lamps.endpoint, lamps.timeout, clock_);
    ASSERT_TRUE(abandoned) << abandoned.error().message;
    ASSERT_TRUE((*abandoned)->write(9, RegisterTable::coil, 5, {1}, false, soon(1s)));
  }
  ASSERT_EQ(world_->lamp_power(), 1) << "the third lamp burns";
  const auto safe = make_safe(bank, clock_);
  EXPECT_TRUE(safe) << safe.error().message;
  EXPECT_EQ(world_->lamp_power(), 0);
}

TEST_P(ModbusSafety, ADriveThatSaysOnlyInPositionIsNotAtRestWhileItMoves) {
  say_no_more_than_in_position();
  backend_.controller.homed.reset();
  for (Axis& axis : rig_.gantry.model.axes) axis.max_speed = 2;
  ASSERT_NO_FATAL_FAILURE(host());
  ASSERT_TRUE(world_->start_homing());
  auto opened = open();
  ASSERT_TRUE(opened) << opened.error().message;
  const auto moving = opened->gantry->status(soon(2s));
  ASSERT_TRUE(moving) << moving.error().message;
  EXPECT_FALSE(moving->at_rest);
  const auto refused = opened->gantry->home(soon(20s));
  ASSERT_FALSE(refused);
  EXPECT_THAT(refused.error().message, HasSubstr("moving already"));
  *opened = {};
  opened = open();
  ASSERT_TRUE(opened) << opened.error().message;
  ASSERT_TRUE(comes_to_rest());
  // Without a homed bit homing ends when the motion does, not at the profile's least delay.
  const auto homed = opened->gantry->home(soon(20s));
  ASSERT_TRUE(homed) << homed.error().message;
  EXPECT_TRUE(world_->gantry_status().at_rest);
  EXPECT_TRUE(world_->gantry_status().homed);
}

// The far end keeps no such bit: a drive that has not yet come within its own window.
TEST_P(ModbusSafety, AMoveHasNotEndedBeforeTheDriveSaysInPosition) {
  ASSERT_NO_FATAL_FAILURE(host());
  backend_.controller.in_position = StatusBit{RegisterTable::holding, 0x0011, 0x8000, 0x8000};
  auto opened = open();
  ASSERT_TRUE(opened) << opened.error().message;
  const auto homed = opened->gantry->home(soon(20s));
  ASSERT_TRUE(homed) << homed.error().message;
  const auto moved = opened->gantry->move_to(test::at_degrees(20, 40), soon(2s));
  ASSERT_FALSE(moved);
  EXPECT_EQ(moved.error().code, ErrorCode::timed_out);
  EXPECT_THAT(moved.error().message, HasSubstr("in position"));
}

TEST_P(ModbusSafety, ADriveThatWasSwitchedOffDoesNotMoveUntilItIsHomedAnew) {
  if (GetParam() != Wire::tcp) GTEST_SKIP() << "a serial line has no second master";
  ASSERT_NO_FATAL_FAILURE(host());
  auto opened = open();
  ASSERT_TRUE(opened) << opened.error().message;
  ASSERT_TRUE(opened->gantry->home(soon(20s)));
  {
    auto other = ModbusBus::open(backend_.drives[1].endpoint, 200ms, clock_);
    ASSERT_TRUE(other) << other.error().message;
    ASSERT_TRUE((*other)->write(backend_.drives[1].unit, RegisterTable::holding, 0x0011, {0}, false,
                                soon(1s)));
  }
  const GantryPosition target = test::at_degrees(20, 40);
  const auto moved = opened->gantry->move_to(target, soon(20s));
  ASSERT_FALSE(moved);
  EXPECT_EQ(moved.error().code, ErrorCode::refused);
  EXPECT_THAT(moved.error().message, HasSubstr(backend_.drives[1].axis + " says that it is not "));
  EXPECT_THAT(moved.error().message, HasSubstr("home the gantry, which enables its drives"));
  EXPECT_TRUE(world_->gantry_status().at_rest) << "no axis moved, the other neither";
  ASSERT_TRUE(opened->gantry->home(soon(20s)));
  EXPECT_TRUE(opened->gantry->move_to(target, soon(20s)));
}

INSTANTIATE_TEST_SUITE_P(Wires, ModbusSafety, testing::Values(Wire::tcp, Wire::rtu),
                         [](const auto& wire) {
                           return std::string(wire.param == Wire::tcp ? "Tcp" : "Rtu");
                         });

}  // namespace
}  // namespace lightrig
