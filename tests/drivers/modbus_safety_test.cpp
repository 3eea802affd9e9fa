// What the Modbus gantry does so that nothing moves or burns that should not: made safe after its
// program died, no move from a drive that moves, is not enabled or not in position.
#include <arpa/inet.h>
#include <fcntl.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <chrono>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include "sim/wire_faults.h"
#include "tests/drivers/own_network.h"
#include "tests/drivers/wire_rig.h"

namespace lightrig {
namespace {

using namespace std::chrono_literals;
using testing::HasSubstr;

using Wire = test::ModbusWireKind;

/// CRC of a frame on a serial line [Modbus over Serial Line 1.02, 6.2.2].
std::uint16_t crc_of(const std::vector<std::uint8_t>& bytes) {
  std::uint16_t crc = 0xffff;
  for (const std::uint8_t byte : bytes) {
    crc ^= byte;
    for (int bit = 0; bit < 8; ++bit)
      crc = static_cast<std::uint16_t>((crc & 1) != 0 ? crc >> 1 ^ 0xa001 : crc >> 1);
  }
  return crc;
}

/// One request by another master, which then goes away: true if it was answered without exception.
bool ask_by_hand(const std::variant<TcpEndpoint, SerialEndpoint>& endpoint,
                 std::vector<std::uint8_t> request) {
  int wire = -1;
  std::size_t head = 0;
  const auto* tcp = std::get_if<TcpEndpoint>(&endpoint);
  if (tcp != nullptr) {
    wire = socket(AF_INET, SOCK_STREAM, 0);
    sockaddr_in to{};
    to.sin_family = AF_INET;
    to.sin_port = htons(static_cast<std::uint16_t>(tcp->port));
    inet_pton(AF_INET, tcp->host.c_str(), &to.sin_addr);
    if (connect(wire, reinterpret_cast<const sockaddr*>(&to), sizeof to) != 0) return false;
    const std::vector<std::uint8_t> prefix{0, 1, 0,
                                           0, 0, static_cast<std::uint8_t>(request.size())};
    request.insert(request.begin(), prefix.begin(), prefix.end());
    head = prefix.size();
  } else {
    wire = ::open(std::get<SerialEndpoint>(endpoint).device.c_str(), O_RDWR | O_NOCTTY);
    const std::uint16_t crc = crc_of(request);
    request.push_back(static_cast<std::uint8_t>(crc & 0xff));
    request.push_back(static_cast<std::uint8_t>(crc >> 8));
  }
  std::vector<std::uint8_t> answer;
  const bool sent =
      write(wire, request.data(), request.size()) == static_cast<ssize_t>(request.size());
  pollfd ready{wire, POLLIN, 0};
  while (sent && answer.size() < request.size() && poll(&ready, 1, 2000) > 0) {
    std::uint8_t byte = 0;
    if (read(wire, &byte, 1) != 1) break;
    answer.push_back(byte);
  }
  close(wire);
  return answer.size() > head + 1 && (answer[head + 1] & 0x80) == 0;
}

class ModbusSafety : public testing::TestWithParam<Wire>, protected test::ModbusLab {
 protected:
  void SetUp() override {
    if (const std::string obstacle = connect_by(GetParam()); !obstacle.empty())
      GTEST_SKIP() << obstacle;
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
  // The drive that answers was told to stop; nobody can tell the other.
  const double stopped = world_->gantry_status().position.axes[0];
  std::this_thread::sleep_for(300ms);
  EXPECT_EQ(world_->gantry_status().position.axes[0], stopped);
  EXPECT_FALSE(world_->gantry_status().at_rest);
}

/// A serial line is where units share one wire's step.
class ModbusSharedLine : public ModbusSafety {
 protected:
  /// Slow axes that stand where homing ends, so that homing takes no time and a move all the more.
  void be_slow() {
    for (Axis& axis : rig_.gantry.model.axes) {
      axis.max_speed = 0.3;
      axis.home = axis.min + 0.3 * (axis.max - axis.min);
    }
  }
  /// The far end, of which this unit can be made to fall silent for good.
  void host_mortal(int number) {
    world_ = test::world_of(rig_, clock_);
    rig_.gantry.backend = backend_;
    faults_ = std::make_shared<sim::WireFaults>(world_);
    auto wires = sim::host_wire(rig_, backend_, world_, faults_);
    ASSERT_TRUE(wires) << wires.error().message;
    hosted_ = std::move(*wires);
    dies_ = "silence unit=" + std::to_string(number) + " count=1000000";
  }
  void kill_it() { ASSERT_TRUE(faults_->add(sim::parse_wire_fault(dies_).value())); }

  std::shared_ptr<sim::WireFaults> faults_;
  std::string dies_;
};

TEST_P(ModbusSharedLine, ADriveThatDiesKeepsNoOtherFromStoppingNorTheLampLit) {
  backend_.controller.watchdog.reset();
  rig_.lamp.backend = lamp_beside_the_drives();
  be_slow();
  ASSERT_NO_FATAL_FAILURE(host_mortal(backend_.drives[0].unit));
  auto opened = open();
  ASSERT_TRUE(opened) << opened.error().message;
  ASSERT_TRUE(opened->gantry->home(soon(60s)));
  ASSERT_TRUE(opened->lamp->set(1, soon(2s)));
  const std::jthread killer = once_moving(200ms, [this] { kill_it(); });
  const auto moved = opened->gantry->move_to(test::at_degrees(150, 80), soon(30s));
  ASSERT_FALSE(moved) << "the first drive, which was read first, is gone";
  std::this_thread::sleep_for(200ms);
  const double second = world_->gantry_status().position.axes[1];
  std::this_thread::sleep_for(300ms);
  EXPECT_EQ(world_->gantry_status().position.axes[1], second) << "the other was told to stop";
  (void)opened->lamp->set(0, soon(200ms));
  EXPECT_TRUE(comes_to_be([this] { return world_->lamp_power() == 0; }))
      << "the lamp's unit answers, and goes dark";
  // And what is known of the units that answer can still be had.
  EXPECT_TRUE(opened->lamp->state(soon(5s)));
}

// The silence that must follow would outlast the patience of a stop.
TEST_P(ModbusSharedLine, AStopAfterALostAnswerDoesNotWaitForTheWireToBeInStep) {
  backend_.timeout = 500ms;
  backend_.controller.watchdog.reset();
  be_slow();
  ASSERT_NO_FATAL_FAILURE(host_mortal(backend_.drives[1].unit));
  auto opened = open();
  ASSERT_TRUE(opened) << opened.error().message;
  ASSERT_TRUE(opened->gantry->home(soon(60s)));
  const std::jthread loser = once_moving(
      200ms, [this] { EXPECT_TRUE(faults_->add(sim::parse_wire_fault("lost_answer").value())); });
  const auto moved = opened->gantry->move_to(test::at_degrees(150, 80), soon(30s));
  ASSERT_FALSE(moved);
  EXPECT_TRUE(comes_to_rest()) << "the way takes nine seconds: a drive was not told";
}

// timeout_ms and watchdog as config/wire_modbus_rtu.toml has them.
TEST_P(ModbusSharedLine, OneLostKeepAliveDoesNotSetOffTheWatchdog) {
  backend_.timeout = 300ms;
  ASSERT_NO_FATAL_FAILURE(host_mortal(0));
  auto opened = open();
  ASSERT_TRUE(opened) << opened.error().message;
  ASSERT_TRUE(faults_->add(sim::parse_wire_fault("silence unit=1").value()));
  std::this_thread::sleep_for(3s);
  EXPECT_EQ(faults_->struck().size(), 1U);
  const auto status = opened->gantry->status(soon(3s));
  ASSERT_TRUE(status) << status.error().message;
  EXPECT_EQ(status->alarm, "");
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
  ASSERT_TRUE(ask_by_hand(lamps.endpoint, {9, 5, 0, 5, 0xff, 0}));
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

// config refuses such a rig; were it let through, the lamp would not be what the rig allows.
TEST_P(ModbusSafety, ACoilGivesAllOfTheLampWhateverTheRigAllows) {
  rig_.lamp.backend = lamp_beside_the_drives();
  rig_.lamp.max_power = rig_.lamp.power = 0.3;
  ASSERT_NO_FATAL_FAILURE(host());
  auto opened = open();
  ASSERT_TRUE(opened) << opened.error().message;
  EXPECT_FALSE(opened->lamp->set(0.3, soon(2s)));
  EXPECT_EQ(world_->lamp_power(), 0);
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

/// Where a second master can connect: a serial line has none.
class ModbusSecondMaster : public ModbusSafety {};

TEST_P(ModbusSecondMaster, FindsADriveThatWasSwitchedOffAtRestUntilItIsHomedAnew) {
  ASSERT_NO_FATAL_FAILURE(host());
  auto opened = open();
  ASSERT_TRUE(opened) << opened.error().message;
  ASSERT_TRUE(opened->gantry->home(soon(20s)));
  const auto unit = static_cast<std::uint8_t>(backend_.drives[1].unit);
  ASSERT_TRUE(ask_by_hand(backend_.drives[1].endpoint, {unit, 6, 0, 0x11, 0, 0}));
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

INSTANTIATE_TEST_SUITE_P(Wires, ModbusSecondMaster, testing::Values(Wire::tcp),
                         [](const auto&) { return "Tcp"; });
INSTANTIATE_TEST_SUITE_P(Wires, ModbusSharedLine, testing::Values(Wire::rtu),
                         [](const auto&) { return "Rtu"; });
INSTANTIATE_TEST_SUITE_P(Wires, ModbusSafety, testing::Values(Wire::tcp, Wire::rtu),
                         [](const auto& wire) {
                           return std::string(wire.param == Wire::tcp ? "Tcp" : "Rtu");
                         });

}  // namespace
}  // namespace lightrig
