// The GRBL gantry against a simulated controller on a pty, and the protocol's words as FIELD notes
// of the firmware have them.
#include <fcntl.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <chrono>
#include <thread>

#include "drivers/make_safe.h"
#include "sim/wire_faults.h"
#include "tests/drivers/wire_rig.h"

namespace lightrig {
namespace {

using namespace std::chrono_literals;

class GrblWire : public testing::Test, protected test::WireLab<GrblGantry> {
 protected:
  void SetUp() override {
    if (!backends()[1].built) GTEST_SKIP() << "USB and serial are left out of this build";
    backend_.letters = {'X', 'Y'};
    backend_.units_per_si = {57.29577951308232, 57.29577951308232};
    SerialEndpoint serial;
    serial.device = testing::TempDir() + "lightrig_grbl_" + std::to_string(getpid());
    backend_.endpoint = serial;
    rig_.lamp.backend = GantryLamp{"spindle"};
    ASSERT_NO_FATAL_FAILURE(host());
  }

  void expect_homed_and_moved(Gantry& gantry) {
    const auto homed = gantry.home(soon(20s));
    ASSERT_TRUE(homed) << homed.error().message;
    const auto target = test::at_degrees(40, 50);
    const auto moved = gantry.move_to(target, soon(10s));
    ASSERT_TRUE(moved) << moved.error().message;
    EXPECT_LE((world_->gantry_status().position.axes - target.axes).cwiseAbs().maxCoeff(),
              rig_.gantry.model.tolerance);
  }
};

TEST_F(GrblWire, IsMadeSafeAfterItsProgramDiedWithTheLampLitAndTheArmMoving) {
  expect_made_safe_with_the_lamp_lit_and_the_arm_moving();
}

TEST_F(GrblWire, HomesMovesAndReadsItsPositionBack) {
  auto opened = open();
  ASSERT_TRUE(opened) << opened.error().message;
  const auto locked = opened->gantry->status(soon(2s));
  ASSERT_TRUE(locked) << locked.error().message;
  EXPECT_FALSE(locked->homed);
  const auto homed = opened->gantry->home(soon(20s));
  ASSERT_TRUE(homed) << homed.error().message;
  for (const auto& target : {test::at_degrees(40, 50), test::at_degrees(-60, 20)}) {
    const auto moved = opened->gantry->move_to(target, soon(10s));
    ASSERT_TRUE(moved) << moved.error().message;
    EXPECT_LE((world_->gantry_status().position.axes - target.axes).cwiseAbs().maxCoeff(),
              rig_.gantry.model.tolerance);
  }
}

// A reset while the arm brakes loses the position, and says so by an alarm: what an ABORT and an
// arming right after it came to.
TEST_F(GrblWire, OpenedAgainWhileTheArmBrakesItWaitsForRestBeforeItResets) {
  for (Axis& axis : rig_.gantry.model.axes) {
    axis.max_speed = 1.5;
    axis.max_acceleration = 1.5;
  }
  host();
  auto opened = open();
  ASSERT_TRUE(opened) << opened.error().message;
  ASSERT_TRUE(opened->gantry->home(soon(20s)));
  const std::jthread stopper = stops_once_moving(700ms);  // up to speed
  ASSERT_FALSE(opened->gantry->move_to(test::at_degrees(160, 80), soon(30s)));
  ASSERT_FALSE(world_->gantry_status().at_rest);
  *opened = {};
  stop_ = {};
  auto again = open();
  ASSERT_TRUE(again) << again.error().message;
  EXPECT_TRUE(world_->gantry_status().at_rest);
  EXPECT_TRUE(world_->gantry_status().homed) << "the controller has lost its position";
  const auto status = again->gantry->status(soon(2s));
  ASSERT_TRUE(status) << status.error().message;
  EXPECT_EQ(status->alarm, "");
}

TEST_F(GrblWire, AfterAStopTheRestOfTheMoveIsNeverDriven) {
  auto opened = open();
  ASSERT_TRUE(opened) << opened.error().message;
  ASSERT_TRUE(opened->gantry->home(soon(20s)));
  const std::jthread stopper = stops_once_moving(100ms);
  const auto moved = opened->gantry->move_to(test::at_degrees(160, 80), soon(30s));
  ASSERT_FALSE(moved);
  EXPECT_EQ(moved.error().code, ErrorCode::stopped) << moved.error().message;
  stop_ = std::stop_source();
  EXPECT_TRUE(comes_to_rest());
  EXPECT_GT(160 * 0.01745 - world_->gantry_status().position.axes[0], 0.1);
  // The position is kept: a move from here works without homing.
  const auto back = opened->gantry->move_to(test::at_degrees(0, 20), soon(20s));
  EXPECT_TRUE(back) << back.error().message;
}

// Only a reset ends a homing. What follows finds the controller in step: a lamp whose 0 went
// unanswered was said to burn, perhaps, after every ABORT of a homing.
TEST_F(GrblWire, AHomingThatIsStoppedLeavesALampThatIsKnownToBeDark) {
  auto opened = open();
  ASSERT_TRUE(opened) << opened.error().message;
  const std::jthread stopper = stops_once_moving(20ms);
  const auto homed = opened->gantry->home(soon(20s));
  ASSERT_FALSE(homed);
  EXPECT_EQ(homed.error().code, ErrorCode::stopped) << homed.error().message;
  stop_ = {};
  const auto dark = opened->lamp->set(0, soon(2s));
  EXPECT_TRUE(dark) << dark.error().message;
  *opened = {};
  auto again = open();
  ASSERT_TRUE(again) << again.error().message;
  if (const auto status = again->gantry->status(soon(2s)); status && !status->alarm.empty()) {
    ASSERT_TRUE(again->gantry->clear_fault(soon(5s)));
  }
  expect_homed_and_moved(*again->gantry);
}

TEST_F(GrblWire, TheLampIsTheSpindleAndGoesDarkWithItsOwner) {
  auto opened = open();
  ASSERT_TRUE(opened) << opened.error().message;
  ASSERT_TRUE(opened->gantry->home(soon(20s)));
  ASSERT_TRUE(opened->lamp);
  const auto set = opened->lamp->set(0.5, soon(2s));
  ASSERT_TRUE(set) << set.error().message;
  EXPECT_NEAR(world_->lamp_power(), 0.5, 1e-3);
  const auto state = opened->lamp->state(soon(2s));
  ASSERT_TRUE(state);
  EXPECT_TRUE(state->confirmed);
  EXPECT_NEAR(state->power, 0.5, 1e-2);
  opened->lamp.reset();
  EXPECT_EQ(world_->lamp_power(), 0.0);
}

// The firmware stops spindle and coolant when the door opens, and heeds no line until it is
// resumed or reset, even after the door was closed.
TEST_F(GrblWire, AnOpenDoorIsSaidTheLampStaysDarkAndOnceClosedEverythingWorks) {
  auto opened = open();
  ASSERT_TRUE(opened) << opened.error().message;
  ASSERT_TRUE(opened->gantry->home(soon(20s)));
  ASSERT_TRUE(opened->lamp->set(0.5, soon(2s)));
  world_->set_interlock("door", true);
  EXPECT_TRUE(comes_to_be([this] { return world_->lamp_power() == 0; }));
  const auto status = opened->gantry->status(soon(2s));
  ASSERT_TRUE(status) << status.error().message;
  EXPECT_EQ(status->open_interlocks, std::vector<std::string>{"door"});
  EXPECT_TRUE(status->at_rest);
  const auto dark = opened->lamp->set(0, soon(1s));
  EXPECT_TRUE(dark) << dark.error().message;
  const auto lit = opened->lamp->set(0.5, soon(1s));
  ASSERT_FALSE(lit);
  EXPECT_EQ(lit.error().code, ErrorCode::refused) << lit.error().message;
  EXPECT_EQ(world_->lamp_power(), 0.0);

  world_->set_interlock("door", false);
  EXPECT_TRUE(comes_to_be([&] {
    const auto now = opened->gantry->status(soon(2s));
    return now && now->open_interlocks.empty();
  }));
  const auto closed = opened->gantry->status(soon(2s));
  ASSERT_TRUE(closed) << closed.error().message;
  EXPECT_TRUE(closed->open_interlocks.empty());
  EXPECT_TRUE(closed->homed) << "at rest a reset keeps the position";
  const auto moved = opened->gantry->move_to(test::at_degrees(20, 30), soon(10s));
  EXPECT_TRUE(moved) << moved.error().message;
  const auto again = opened->lamp->set(0.5, soon(2s));
  EXPECT_TRUE(again) << again.error().message;
  EXPECT_NEAR(world_->lamp_power(), 0.5, 1e-3);
}

// After a hard or soft limit the firmware is silent until a reset: nobody may wait for an answer,
// and making the lamp dark must not make anyone forget the alarm.
TEST_F(GrblWire, ALimitIsSaidAtOnceAndUntilItIsCleared) {
  auto opened = open();
  ASSERT_TRUE(opened) << opened.error().message;
  ASSERT_TRUE(opened->gantry->home(soon(20s)));
  ASSERT_TRUE(opened->lamp->set(1, soon(2s)));
  world_->raise_alarm("limit switch");
  const auto begin = std::chrono::steady_clock::now();
  EXPECT_TRUE(comes_to_be([&] {
    const auto now = opened->gantry->status(soon(20s));
    return now && !now->alarm.empty();
  }));
  const auto status = opened->gantry->status(soon(20s));
  ASSERT_TRUE(status) << status.error().message;
  EXPECT_NE(status->alarm.find("ALARM:1"), std::string::npos) << status->alarm;
  EXPECT_FALSE(status->homed);
  EXPECT_FALSE(opened->gantry->move_to(test::at_degrees(20, 30), soon(20s)));
  EXPECT_FALSE(opened->lamp->set(1, soon(20s)));
  const auto dark = opened->lamp->set(0, soon(20s));
  EXPECT_TRUE(dark) << dark.error().message;
  EXPECT_LT(std::chrono::steady_clock::now() - begin, 15s) << "a wait for an answer takes 20 s";
  EXPECT_EQ(world_->lamp_power(), 0.0);
  const auto still = opened->gantry->status(soon(2s));
  ASSERT_TRUE(still) << still.error().message;
  EXPECT_NE(still->alarm.find("ALARM:1"), std::string::npos) << "forgotten";
  ASSERT_TRUE(opened->gantry->clear_fault(soon(5s)));
  const auto homed = opened->gantry->home(soon(20s));
  EXPECT_TRUE(homed) << homed.error().message;
  EXPECT_EQ(opened->gantry->status(soon(2s))->alarm, "");
}

TEST_F(GrblWire, ALampOnAControllerOfItsOwnIsLostAndOpenedWithoutTheGantrys) {
  SerialEndpoint serial;
  serial.device = testing::TempDir() + "lightrig_lamp_" + std::to_string(getpid());
  const GrblLamp lamp_backend{serial, "flood"};
  rig_.lamp.backend = lamp_backend;
  hosted_.clear();
  world_ = test::world_of(rig_, clock_);
  const auto faults = std::make_shared<sim::WireFaults>(world_);
  auto axes = sim::host_wire(rig_, backend_, world_);
  auto lamps = sim::host_wire(rig_, lamp_backend, world_, faults);
  ASSERT_TRUE(axes && lamps);
  EXPECT_TRUE(lamp_has_own_wire(rig_));
  auto opened = open();
  ASSERT_TRUE(opened) << opened.error().message;
  EXPECT_EQ(opened->lamp, nullptr);
  ASSERT_TRUE(opened->gantry->home(soon(20s)));
  auto lamp = open_lamp(rig_, clock_);
  ASSERT_TRUE(lamp) << lamp.error().message;
  ASSERT_TRUE((*lamp)->set(1, soon(2s)));
  EXPECT_EQ(world_->lamp_power(), 1);
  // The gantry's controller has another lamp's output, or none: its reset leaves ours alone.
  ASSERT_TRUE(opened->gantry->clear_fault(soon(5s)));
  EXPECT_EQ(world_->lamp_power(), 1);

  ASSERT_TRUE(faults->add(*sim::parse_wire_fault("unplug wire=lamp ms=100")));
  for (int i = 0; i < 200 && (*lamp)->state(soon(1s)) && (*lamp)->set(1, soon(1s)); ++i)
    std::this_thread::sleep_for(10ms);
  EXPECT_EQ((*lamp)->set(0, soon(1s)).error().code, ErrorCode::disconnected);
  lamp->reset();
  Result<std::unique_ptr<Lamp>> again = open_lamp(rig_, clock_);
  for (int i = 0; i < 100 && !again; ++i) {
    std::this_thread::sleep_for(20ms);
    again = open_lamp(rig_, clock_);
  }
  ASSERT_TRUE(again) << again.error().message;
  EXPECT_EQ(world_->lamp_power(), 0);  // opening resets the controller: dark
  const auto status = opened->gantry->status(soon(2s));
  ASSERT_TRUE(status) << status.error().message;
  EXPECT_TRUE(status->homed);
}

// Locked until it is homed, a controller switches nothing.
TEST_F(GrblWire, ALampsControllerThatWantsHomingIsRefusedWithTheSettingToChange) {
  rig_.lamp.backend = GrblLamp{backend_.endpoint, "flood"};
  const auto lamp = open_lamp(rig_, clock_);
  ASSERT_FALSE(lamp);
  EXPECT_EQ(lamp.error().code, ErrorCode::refused);
  EXPECT_NE(lamp.error().message.find("$22=0"), std::string::npos) << lamp.error().message;
}

TEST_F(GrblWire, AControllerFasterThanTheRigAllowsIsRefusedWithTheSettingToChange) {
  rig_.gantry.model.axes[1].max_acceleration /= 10;
  const auto opened = open();
  ASSERT_FALSE(opened);
  EXPECT_EQ(opened.error().code, ErrorCode::refused);
  EXPECT_NE(opened.error().message.find("$121"), std::string::npos) << opened.error().message;
}

// "A negative number turns the sense."
TEST_F(GrblWire, AnAxisThatCountsTheOtherWayMovesWhereItIsTold) {
  backend_.units_per_si[0] *= -1;
  host();
  auto opened = open();
  ASSERT_TRUE(opened) << opened.error().message;
  ASSERT_NO_FATAL_FAILURE(expect_homed_and_moved(*opened->gantry));
  *opened = {};
  rig_.gantry.model.axes[0].max_acceleration /= 10;
  const auto too_fast = open();
  ASSERT_FALSE(too_fast);
  EXPECT_NE(too_fast.error().message.find("$120"), std::string::npos) << too_fast.error().message;
}

TEST_F(GrblWire, AControllerThatReportsInWorkCoordinatesIsUnderstood) {
  const int line = ::open(std::get<SerialEndpoint>(backend_.endpoint).device.c_str(), O_RDWR);
  ASSERT_GE(line, 0);
  ASSERT_EQ(write(line, "$10=0\n", 6), 6);
  std::this_thread::sleep_for(300ms);  // the far end reads it, whoever comes next
  ::close(line);
  auto opened = open();
  ASSERT_TRUE(opened) << opened.error().message;
  ASSERT_NO_FATAL_FAILURE(expect_homed_and_moved(*opened->gantry));
}

TEST_F(GrblWire, NoSuchDeviceSaysSo) {
  std::get<SerialEndpoint>(backend_.endpoint).device = "/dev/lightrig-none";
  const auto opened = open();
  ASSERT_FALSE(opened);
  EXPECT_EQ(opened.error().code, ErrorCode::not_found) << opened.error().message;
}

}  // namespace
}  // namespace lightrig
