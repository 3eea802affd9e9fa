// What the simulated GRBL controller makes of G-code that our driver never sends: else both could
// be wrong together.
#include "sim/usb/grbl_machine.h"

#include <gmock/gmock.h>

#include <limits>

#include "sim/sim_clock.h"
#include "tests/drivers/wire_rig.h"

namespace lightrig {
namespace {

using namespace std::chrono_literals;
using testing::HasSubstr;

TEST(GrblMachine, CountsInWorkCoordinatesUnlessToldOtherwiseAndMovesAtTheFeed) {
  const auto clock = sim::make_clock(std::numeric_limits<double>::infinity());
  Rig rig = test::quick_rig();
  auto world = test::world_of(rig, *clock);
  GrblGantry backend;
  backend.letters = {'X', 'Y'};
  const double degrees = 57.29577951308232;
  backend.units_per_si = {degrees, degrees};
  sim::GrblMachine machine(backend, world);
  const auto pass = [&](std::chrono::milliseconds time) {
    clock->sleep_until(clock->now() + time, {});
    return machine.tick();
  };
  machine.receive("$H\n");
  EXPECT_EQ(pass(600s), "ok\r\n");
  const double home = rig.gantry.model.axes[0].home;
  const auto azimuth = [&] { return (world->gantry_status().position.axes[0] - home) * degrees; };
  EXPECT_EQ(machine.receive("G1 X-20\n"), "error:22\r\n") << "no feed yet";
  EXPECT_EQ(machine.receive("G53 G1 X-20 F600\n"), "ok\r\n");
  pass(1000ms);
  EXPECT_NEAR(azimuth(), -10, 1) << "ten units a second";
  EXPECT_THAT(machine.receive("?"), HasSubstr("<Run|MPos:"));
  pass(3000ms);
  EXPECT_NEAR(azimuth(), -20, 1e-6);
  EXPECT_EQ(machine.receive("X-20\n"), "ok\r\n");
  pass(3000ms);
  EXPECT_NEAR(azimuth(), -15, 1e-6) << "in work coordinates, whose zero lies at 5";
  EXPECT_EQ(machine.receive("G91 X2\n"), "ok\r\n");
  pass(3000ms);
  EXPECT_NEAR(azimuth(), -13, 1e-6);
  EXPECT_EQ(machine.receive("$10=0\n"), "ok\r\n");
  EXPECT_THAT(machine.receive("?"), HasSubstr("<Idle|WPos:-18.000,3.000,-2.000|FS:0,0"));
  std::string reports;
  for (int i = 0; i < 30; ++i) reports += machine.receive("?");
  EXPECT_THAT(reports, HasSubstr("|WCO:5.000,-3.000,2.000>"));
  machine.receive("\x18");
  EXPECT_EQ(machine.receive("G53 G1 X0\n"), "error:22\r\n") << "a reset forgets the feed";
  EXPECT_EQ(machine.receive("G90\r\n"), "ok\r\nok\r\n");
}

}  // namespace
}  // namespace lightrig
