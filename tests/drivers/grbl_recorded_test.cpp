// Our GRBL driver against the firmware's own words, as they were recorded of GRBL 1.1 and are told
// of grblHAL: a far end that knows nothing but its lines, and nothing of our simulator.
#include <gmock/gmock.h>

#include <atomic>
#include <deque>
#include <map>
#include <mutex>

#include "sim/usb/grbl_machine.h"
#include "tests/drivers/pty_peer.h"
#include "tests/drivers/wire_rig.h"

namespace lightrig {
namespace {

using namespace std::chrono_literals;
using testing::HasSubstr;

constexpr const char* banner = "\r\nGrbl 1.1h ['$' for help]\r\n";
constexpr const char* locked = "[MSG:'$H'|'$X' to unlock]\r\n";
constexpr const char* settings =
    "$0=10\r\n$10=1\r\n$13=0\r\n$22=1\r\n$30=1000\r\n$31=0\r\n$32=0\r\n$120=1000.000\r\n"
    "$121=1000.000\r\n$122=10.000\r\nok\r\n";

/// Plays lines: an answer to each line it hears, and status reports in order, the last of them for
/// ever. What it hears and has no answer for is met with silence.
class Recording {
 public:
  void answer(const std::string& line, const std::string& text) {
    const std::lock_guard lock(mutex_);
    answers_[line] = text;
  }
  /// Reports once a line was heard, or "!" or "reset".
  void report_after(const std::string& what, std::deque<std::string> reports) {
    const std::lock_guard lock(mutex_);
    reports_after_[what] = std::move(reports);
  }
  void say_after_reset(const std::string& text) {
    const std::lock_guard lock(mutex_);
    after_reset_ = text;
  }

  std::string hear(std::string_view bytes) {
    const std::lock_guard lock(mutex_);
    std::string said;
    for (const char byte : bytes) {
      if (byte == 0x18) {
        heard_.emplace_back("reset");
        silent_until_reset_ = false;
        said += after_reset_;
        now("reset");
      } else if (byte == '?') {
        if (silent_until_reset_) continue;
        said += reports_.front() + "\r\n";
        if (reports_.size() > 1) reports_.pop_front();
      } else if (byte == '!') {
        heard_.emplace_back("!");
        now("!");
      } else if (byte == '\n') {
        const std::string line = std::exchange(line_, {});
        heard_.push_back(line);
        if (silent_until_reset_) continue;
        if (const auto answer = answers_.find(line); answer != answers_.end())
          said += answer->second;
        if (said.ends_with("ALARM:2\r\n")) silent_until_reset_ = true;
        now(line);
      } else {
        line_ += byte;
      }
    }
    return said;
  }
  std::vector<std::string> heard() const {
    const std::lock_guard lock(mutex_);
    return heard_;
  }

 private:
  void now(const std::string& happened) {
    if (const auto next = reports_after_.find(happened); next != reports_after_.end())
      reports_ = next->second;
  }

  mutable std::mutex mutex_;
  std::map<std::string, std::string> answers_{
      {"$$", settings}, {"G21", "ok\r\n"}, {"G90", "ok\r\n"}, {"G94", "ok\r\n"}, {"M5", "ok\r\n"}};
  std::deque<std::string> reports_{"<Alarm|MPos:0.000,0.000,0.000|FS:0,0|WCO:0.000,0.000,0.000>"};
  std::map<std::string, std::deque<std::string>> reports_after_;
  std::string after_reset_ = std::string(banner) + locked;
  bool silent_until_reset_ = false;
  std::string line_;
  std::vector<std::string> heard_;
};

class GrblRecorded : public testing::Test {
 protected:
  void SetUp() override {
    if (!backends()[1].built) GTEST_SKIP() << "USB and serial are left out of this build";
    for (Axis& axis : rig_.gantry.model.axes) {  // one degree a second
      axis.home = 0;
      axis.max_speed = degree;
      axis.max_acceleration = 100;
    }
    rig_.lamp.backend = GantryLamp{"spindle"};
    recording_.answer("$H", "ok\r\n");
    // Homed, it stands a pull-off away from its switches.
    recording_.report_after("$H", {"<Idle|MPos:-1.000,-1.000,-1.000|FS:0,0|Ov:100,100,100>"});
  }

  Result<GantryAndLamp> open(char second = 'Y') {
    GrblGantry backend;
    backend.letters = {'X', second};
    backend.units_per_si = {1 / degree, 1 / degree};
    SerialEndpoint serial;
    serial.device = peer_.path();
    backend.endpoint = serial;
    return open_gantry(rig_, backend, clock_);
  }
  Until soon(std::chrono::milliseconds time) { return {clock_.now() + time, {}}; }

  static constexpr double degree = 0.017453292519943295;
  /// To 3° and 12°, eleven of them further than where it stands: a degree a second along the
  /// slower axis is 60 · √(3² + 12²) / 12 units a minute along the way.
  static constexpr const char* move = "G53 G1 X2.0000 Y11.0000 F61.847";
  RealClock clock_;
  Rig rig_ = test::quick_rig();
  Recording recording_;
  test::PtyPeer peer_{[this](std::string_view bytes) { return recording_.hear(bytes); }};
};

TEST_F(GrblRecorded, HomesAndArrivesWhenItIsIdleThereNotWhenItSaysOk) {
  // Noise comes before the banner.
  recording_.say_after_reset("\x01\xfe<Id" + std::string(banner) + locked);
  auto opened = open();
  ASSERT_TRUE(opened) << opened.error().message;
  const auto homed = opened->gantry->home(soon(2s));
  ASSERT_TRUE(homed) << homed.error().message;
  recording_.answer(move, "ok\r\n");
  recording_.report_after(
      move, {"<Idle|MPos:-1.000,-1.000,-1.000|FS:0,0>", "<Run|MPos:0.500,5.000,-1.000|FS:62,0>",
             "<Run|MPos:1.900,10.600,-1.000|FS:20,0|WCO:0.000,0.000,0.000>",
             "<Idle|MPos:2.000,11.000,-1.000|FS:0,0>"});
  const auto moved = opened->gantry->move_to(test::at_degrees(3, 12), soon(5s));
  ASSERT_TRUE(moved) << moved.error().message;
  EXPECT_EQ(recording_.heard().back(), move);
  const auto status = opened->gantry->status(soon(1s));
  ASSERT_TRUE(status);
  EXPECT_NEAR(status->position.axes[1], 12 * degree, 1e-9);
}

TEST_F(GrblRecorded, AStopIsAHoldAndAResetOnlyOnceItRests) {
  auto opened = open();
  ASSERT_TRUE(opened) << opened.error().message;
  ASSERT_TRUE(opened->gantry->home(soon(2s)));
  recording_.answer(move, "ok\r\n");
  recording_.report_after(move, {"<Run|MPos:0.500,5.000,-1.000|FS:62,0>"});
  recording_.report_after(
      "!", {"<Hold:1|MPos:0.600,5.300,-1.000|FS:30,0>", "<Hold:1|MPos:0.650,5.500,-1.000|FS:5,0>",
            "<Hold:0|MPos:0.650,5.550,-1.000|FS:0,0>"});
  const auto moved = opened->gantry->move_to(test::at_degrees(3, 12), soon(2s));
  ASSERT_FALSE(moved);
  EXPECT_EQ(moved.error().code, ErrorCode::timed_out) << moved.error().message;
  recording_.say_after_reset(banner);
  recording_.report_after("reset", {"<Idle|MPos:0.650,5.550,-1.000|FS:0,0|WCO:0.000,0.000,0.000>"});
  const std::string next = "G53 G1 X0.0000 Y12.0000 F60.304";
  recording_.answer(next, "ok\r\n");
  recording_.report_after(
      next, {"<Run|MPos:0.500,6.000,-1.000|FS:60,0>", "<Idle|MPos:0.000,12.000,-1.000|FS:0,0>"});
  const auto on = opened->gantry->move_to(test::at_degrees(1, 13), soon(5s));
  EXPECT_TRUE(on) << on.error().message;
  auto heard = recording_.heard();
  heard.erase(std::unique(heard.begin(), heard.end()), heard.end());  // resets may be two
  ASSERT_GE(heard.size(), 4U);
  EXPECT_THAT(std::vector<std::string>(heard.end() - 4, heard.end()),
              testing::ElementsAre(move, "!", "reset", next));
}

// GRBL has no checksum: another target than ours, made by a digit that was lost, is noticed on the
// way there, not at its end; and one report that is damaged is not enough.
TEST_F(GrblRecorded, AMoveThatLeavesItsWayIsStoppedThere) {
  auto opened = open();
  ASSERT_TRUE(opened) << opened.error().message;
  ASSERT_TRUE(opened->gantry->home(soon(2s)));
  recording_.answer(move, "ok\r\n");
  recording_.report_after(
      move, {"<Run|MPos:0.500,5.000,-1.000|FS:62,0>", "<Run|MPos:90.500,5.100,-1.000|FS:62,0>",
             "<Run|MPos:0.520,5.200,-1.000|FS:62,0>", "<Run|MPos:4.000,5.300,-1.000|FS:62,0>",
             "<Run|MPos:4.100,5.400,-1.000|FS:62,0>", "<Run|MPos:99.000,99.000,-1.000|FS:62,0>"});
  const auto moved = opened->gantry->move_to(test::at_degrees(3, 12), soon(20s));
  ASSERT_FALSE(moved);
  EXPECT_EQ(moved.error().code, ErrorCode::timed_out);
  EXPECT_THAT(moved.error().message, HasSubstr("leaves the way to its target"))
      << "at the second report beside it: 5.6° of elevation away";
  for (int i = 0; i < 100 && recording_.heard().back() != "!"; ++i)
    std::this_thread::sleep_for(5ms);
  EXPECT_EQ(recording_.heard().back(), "!");
}

TEST_F(GrblRecorded, ASoftLimitIsAlarm2AndSilenceUntilAReset) {
  auto opened = open();
  ASSERT_TRUE(opened) << opened.error().message;
  ASSERT_TRUE(opened->gantry->home(soon(2s)));
  recording_.answer(move, "ALARM:2\r\n");
  const auto moved = opened->gantry->move_to(test::at_degrees(3, 12), soon(20s));
  ASSERT_FALSE(moved);
  EXPECT_EQ(moved.error().code, ErrorCode::refused);
  EXPECT_THAT(moved.error().message, HasSubstr("ALARM:2 (soft limit"));
  recording_.report_after("reset", {"<Alarm|MPos:-1.000,-1.000,-1.000|FS:0,0>"});
  EXPECT_TRUE(opened->gantry->clear_fault(soon(2s)));
  EXPECT_FALSE(opened->gantry->status(soon(1s))->homed);
}

TEST_F(GrblRecorded, AResetInMotionIsAlarm3AndThePositionIsNotBelievedAnyMore) {
  auto opened = open();
  ASSERT_TRUE(opened) << opened.error().message;
  ASSERT_TRUE(opened->gantry->home(soon(2s)));
  EXPECT_TRUE(opened->gantry->status(soon(1s))->homed);
  recording_.say_after_reset("ALARM:3\r\n" + std::string(banner) + locked);
  recording_.report_after("reset", {"<Alarm|MPos:0.500,5.000,-1.000|FS:0,0>"});
  ASSERT_TRUE(opened->gantry->clear_fault(soon(1s)));
  const auto status = opened->gantry->status(soon(1s));
  ASSERT_TRUE(status) << status.error().message;
  EXPECT_FALSE(status->homed);
  const auto moved = opened->gantry->move_to(test::at_degrees(3, 12), soon(1s));
  ASSERT_FALSE(moved);
  EXPECT_EQ(moved.error().code, ErrorCode::refused);
  EXPECT_THAT(moved.error().message, HasSubstr("not homed"));
}

TEST_F(GrblRecorded, AHomingThatFailsIsAlarm8AndGCodeIsLockedOutAfterIt) {
  recording_.answer("$H", "ALARM:8\r\n");
  recording_.report_after("$H", {"<Alarm|MPos:0.000,0.000,0.000|FS:0,0>"});
  recording_.answer("M5", "error:9\r\n");
  auto opened = open();
  ASSERT_TRUE(opened) << opened.error().message;
  const auto homed = opened->gantry->home(soon(2s));
  ASSERT_FALSE(homed);
  EXPECT_EQ(homed.error().code, ErrorCode::refused);
  EXPECT_THAT(homed.error().message, HasSubstr("ALARM:8 (homing failed: the limit switch did not"));
  EXPECT_FALSE(opened->lamp->set(0.5, soon(1s)));
  const auto dark = opened->lamp->set(0, soon(1s));
  EXPECT_TRUE(dark) << "a reset darkens what error:9 did not: " << dark.error().message;
  EXPECT_EQ(recording_.heard().back(), "reset");
}

// A line that is lost is not a 0, and one that is damaged is not believed.
TEST_F(GrblRecorded, SettingsAreReadUntilTwoReadingsAgreeAndNoneThatIsNeededMayLack) {
  struct Reading {
    const char* lost;
    const char* instead;
  };
  for (const auto& [lost, instead] : {Reading{"$121=1000.000\r\n", ""},
                                      {"$121=1000.000", "$12\x01=1000.000"},
                                      {"$30=1000", "$30=9000"},
                                      {"$22=1\r\n", ""}}) {
    std::string damaged = settings;
    damaged.replace(damaged.find(lost), std::string(lost).size(), instead);
    std::atomic<int> readings{0};
    test::PtyPeer once([&](std::string_view bytes) {
      std::string said;
      for (std::string part(bytes); !part.empty();) {
        const std::size_t end = part.find("$$\n");
        said += recording_.hear(part.substr(0, end));
        if (end == std::string::npos) break;
        said += readings++ == 0 ? damaged : settings;
        part.erase(0, end + 3);
      }
      return said;
    });
    GrblGantry backend;
    backend.letters = {'X', 'Y'};
    backend.units_per_si = {1 / degree, 1 / degree};
    SerialEndpoint serial;
    serial.device = once.path();
    backend.endpoint = serial;
    const auto opened = open_gantry(rig_, backend, clock_);
    EXPECT_TRUE(opened) << lost << ": " << opened.error().message;
    EXPECT_EQ(readings, 3) << lost;
  }
  for (const auto& [lost, name] : {std::pair{"$121=1000.000\r\n", "$121"},
                                   {"$22=1\r\n", "$22"},
                                   {"$13=0\r\n", "$13"},
                                   {"$30=1000\r\n", "$30"},
                                   {"$32=0\r\n", "$32"}}) {
    std::string less = settings;
    less.erase(less.find(lost), std::string(lost).size());
    recording_.answer("$$", less);
    const auto opened = open();
    ASSERT_FALSE(opened) << name;
    EXPECT_EQ(opened.error().code, ErrorCode::refused);
    EXPECT_THAT(opened.error().message, HasSubstr(name));
  }
}

// It reports X, Y and Z; a fourth axis that is not there is not at zero.
TEST_F(GrblRecorded, AReportThatLacksAnAxisOfTheRigFileIsNotBelieved) {
  const auto unknown = open('A');
  ASSERT_FALSE(unknown);
  EXPECT_THAT(unknown.error().message, HasSubstr("$123"));
  recording_.answer("$$", "$123=10.000\r\n" + std::string(settings));
  auto opened = open('A');
  ASSERT_TRUE(opened) << opened.error().message;
  const auto status = opened->gantry->status(soon(300ms));
  ASSERT_FALSE(status);
  EXPECT_EQ(status.error().code, ErrorCode::timed_out);
  EXPECT_THAT(status.error().message, HasSubstr("reports 3 axes, the rig file's letters need 4"));
}

// To grblHAL an error lasts until an empty line, and CRLF is one line.
TEST_F(GrblRecorded, AfterAnErrorGrblHalIsGivenTheEmptyLineThatItWaitsFor) {
  std::mutex mutex;
  bool damage = false;
  rig_ = test::quick_rig();
  rig_.lamp.backend = GantryLamp{"spindle"};
  for (Axis& axis : rig_.gantry.model.axes)
    axis.home = axis.min + 0.3 * (axis.max - axis.min) + 0.02;
  GrblGantry backend;
  backend.letters = {'X', 'Y'};
  backend.units_per_si = {1 / degree, 1 / degree};
  auto world = test::world_of(rig_, clock_);
  sim::GrblMachine machine(backend, world, sim::GrblFirmware::hal);
  int resets = 0;
  test::PtyPeer hal(
      [&](std::string_view bytes) {
        const std::lock_guard lock(mutex);
        resets += static_cast<int>(std::count(bytes.begin(), bytes.end(), 0x18));
        std::string line(bytes);
        if (damage && line.starts_with("M3")) line[1] = 'x';
        return machine.receive(line);
      },
      [&] {
        const std::lock_guard lock(mutex);
        return machine.tick();
      });
  SerialEndpoint serial;
  serial.device = hal.path();
  backend.endpoint = serial;
  auto opened = open_gantry(rig_, backend, clock_);
  ASSERT_TRUE(opened) << opened.error().message;
  const auto homed = opened->gantry->home(soon(20s));
  ASSERT_TRUE(homed) << homed.error().message;
  const auto set_damage = [&](bool on) {
    const std::lock_guard lock(mutex);
    resets = 0;
    damage = on;
  };
  set_damage(true);
  const auto spoiled = opened->lamp->set(0.5, soon(2s));
  ASSERT_FALSE(spoiled);
  EXPECT_THAT(spoiled.error().message, HasSubstr("error:1"));
  {
    const std::lock_guard lock(mutex);
    damage = false;
  }
  const auto lit = opened->lamp->set(0.5, soon(2s));
  EXPECT_TRUE(lit) << lit.error().message;
  const auto moved = opened->gantry->move_to(test::at_degrees(20, 30), soon(10s));
  EXPECT_TRUE(moved) << moved.error().message;
  const std::lock_guard lock(mutex);
  EXPECT_EQ(resets, 0) << "the lamp would have gone dark";
}

}  // namespace
}  // namespace lightrig
