// GRBL's words, damaged on the way: what is no number is no report.
#include "drivers/grbl_protocol.h"

#include <gtest/gtest.h>

#include <chrono>

#include "drivers/write_within.h"

namespace lightrig::grbl {
namespace {

using namespace std::chrono_literals;

TEST(GrblProtocol, AReportWithANumberThatIsNoneIsNoReport) {
  ASSERT_TRUE(parse_status("<Hold:1|MPos:1.000,-2.500,0.000|FS:0,500>"));
  for (const char* damaged :
       {"<Idle|MPos:nan,0.000,0.000>", "<Idle|MPos:inf,0.000,0.000>",
        "<Idle|MPos:-inf,0.000,0.000>", "<Idle|MPos:1e300,0.000,0.000>",
        "<Idle|MPos:1e999,0.000,0.000>", "<Idle|MPos:1.0x,0.000,0.000>", "<Idle|MPos:,0.000>",
        "<Hold:nan|MPos:0,0,0>", "<Hold:1e300|MPos:0,0,0>", "<Hold:99999999999|MPos:0,0,0>",
        "<Door:x|MPos:0,0,0>", "<Idle|MPos:0,0,0|FS:0,nan>", "<Idle|MPos:0,0,0|WCO:inf,0,0>"})
    EXPECT_FALSE(parse_status(damaged)) << damaged;
}

TEST(GrblProtocol, AnAlarmWhoseNumberCannotBeReadIsAnAlarmStill) {
  EXPECT_EQ(parse_line("ALARM:3").number, 3);
  for (const char* damaged : {"ALARM:99999999999999999999", "ALARM:", "ALARM:x", "error:1e3"}) {
    const Line line = parse_line(damaged);
    EXPECT_EQ(line.kind, damaged[0] == 'A' ? Line::Kind::alarm : Line::Kind::error) << damaged;
    EXPECT_EQ(line.number, unreadable_number) << damaged;
  }
}

TEST(GrblProtocol, ASettingThatIsNoNumberIsNoSetting) {
  const Line sound = parse_line("$120=250.000");
  EXPECT_EQ(sound.kind, Line::Kind::setting);
  EXPECT_EQ(sound.number, 120);
  EXPECT_EQ(sound.value, 250);
  for (const char* damaged : {"$120=nan", "$120=inf", "$1e300=1", "$12.5=1", "$=1", "$120="})
    EXPECT_NE(parse_line(damaged).kind, Line::Kind::setting) << damaged;
}

TEST(WriteWithin, AWireThatTakesNothingEndsAtThePatienceAndOneThatTakesLittleTakesAll) {
  const auto nothing = [](std::string_view, std::chrono::milliseconds) -> Result<std::size_t> {
    return 0;
  };
  const auto stuck = write_within("G53 G1", 30ms, "the wire", nothing);
  ASSERT_FALSE(stuck);
  EXPECT_EQ(stuck.error().code, ErrorCode::timed_out);
  std::string taken;
  std::chrono::milliseconds last = 1min;
  const auto little = [&](std::string_view rest, std::chrono::milliseconds left) {
    EXPECT_LE(left, last) << "each transfer has what the ones before have left";
    last = left;
    taken += rest.substr(0, 1);
    return Result<std::size_t>(1);
  };
  EXPECT_TRUE(write_within("G53 G1", 1min, "the wire", little));
  EXPECT_EQ(taken, "G53 G1");
}

}  // namespace
}  // namespace lightrig::grbl
