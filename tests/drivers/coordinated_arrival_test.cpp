// Several drives make one gantry, here on two hosts: what is written to each is read back by a
// master of this test's own (a Modbus TCP request by hand), and by the closed form of a trapezoid
// they arrive together.
#include <arpa/inet.h>
#include <gtest/gtest.h>
#include <sys/socket.h>
#include <unistd.h>

#include <array>
#include <chrono>
#include <cmath>

#include "tests/drivers/own_network.h"
#include "tests/drivers/wire_rig.h"

namespace lightrig {
namespace {

using namespace std::chrono_literals;

/// Reads holding registers [Modbus Messaging on TCP/IP 1.0b, 3.1; Application Protocol 1.1b3, 6.3].
std::vector<std::uint16_t> read_registers(const char* host, int port, std::uint8_t unit,
                                          std::uint16_t address, std::uint8_t count) {
  const int wire = socket(AF_INET, SOCK_STREAM, 0);
  sockaddr_in to{};
  to.sin_family = AF_INET;
  to.sin_port = htons(static_cast<std::uint16_t>(port));
  inet_pton(AF_INET, host, &to.sin_addr);
  std::vector<std::uint16_t> values;
  std::array<std::uint8_t, 260> answer{};
  const std::array<std::uint8_t, 12> request{0,
                                             7,
                                             0,
                                             0,
                                             0,
                                             6,
                                             unit,
                                             3,
                                             static_cast<std::uint8_t>(address >> 8),
                                             static_cast<std::uint8_t>(address & 0xff),
                                             0,
                                             count};
  const std::size_t expected = 9 + 2 * std::size_t{count};
  if (connect(wire, reinterpret_cast<const sockaddr*>(&to), sizeof to) == 0 &&
      send(wire, request.data(), request.size(), 0) == static_cast<ssize_t>(request.size()) &&
      recv(wire, answer.data(), expected, MSG_WAITALL) == static_cast<ssize_t>(expected))
    for (std::size_t i = 9; i < expected; i += 2)
      values.push_back(static_cast<std::uint16_t>(answer.at(i) << 8 | answer.at(i + 1)));
  close(wire);
  return values;
}

/// What a drive of config/controllers/generic.toml was told: registers 0x0100 … 0x0105, high word
/// first.
struct Told {
  double position = 0, speed = 0, acceleration = 0;  ///< [counts], [counts/s], [counts/s²]
};
Told what_was_told(const char* host, std::uint8_t unit) {
  const auto words = read_registers(host, 1502, unit, 0x0100, 6);
  if (words.size() != 6) return {};
  const auto value = [&](std::size_t i) {
    return static_cast<std::uint32_t>(words[i]) << 16 | words[i + 1];
  };
  return {static_cast<double>(static_cast<std::int32_t>(value(0))), static_cast<double>(value(2)),
          static_cast<double>(value(4))};
}

/// Time of a trapezoid, or of a triangle where the way is too short to reach the speed.
double travel_time(double way, const Told& told) {
  const double ramp = told.speed / told.acceleration;
  if (way < told.speed * ramp) return 2 * std::sqrt(way / told.acceleration);
  return way / told.speed + ramp;
}

TEST(CoordinatedArrival, DrivesOnTwoHostsAreToldSpeedsWithWhichTheyArriveTogether) {
  if (!backends().front().built) GTEST_SKIP() << "Modbus is left out of this build";
  const std::string obstacle = test::enter_own_network();
  if (!obstacle.empty()) GTEST_SKIP() << obstacle;
  RealClock clock;
  Rig rig = test::quick_rig();
  rig.gantry.model.axes[1].max_speed = 2;  // not the same for both
  auto backend = std::get<ModbusGantry>(rig.gantry.backend);
  backend.drives[0].endpoint = TcpEndpoint{"127.0.0.1", 1502};
  backend.drives[1].endpoint = TcpEndpoint{"127.0.0.2", 1502};
  rig.gantry.backend = backend;
  const auto world = test::world_of(rig, clock);
  const auto hosted = sim::host_wire(rig, backend, world);
  ASSERT_TRUE(hosted) << hosted.error().message;
  ASSERT_EQ(hosted->size(), 2U) << "a server for each host";
  auto opened = open_gantry(rig, backend, clock);
  ASSERT_TRUE(opened) << opened.error().message;
  const auto soon = [&] { return Until{clock.now() + 20s, {}}; };
  const auto homed = opened->gantry->home(soon());
  ASSERT_TRUE(homed) << homed.error().message;

  AxisValues from = world->gantry_status().position.axes;
  for (const auto& target : {test::at_degrees(150, 30), test::at_degrees(140, 80),
                             test::at_degrees(139, 79), test::at_degrees(-10, 79)}) {
    const auto moved = opened->gantry->move_to(target, soon());
    ASSERT_TRUE(moved) << moved.error().message;
    std::array<double, 2> seconds{};
    for (std::size_t i = 0; i < 2; ++i) {
      const Axis& axis = rig.gantry.model.axes[i];
      const auto row = static_cast<Eigen::Index>(i);
      const double counts_per_si = std::abs(backend.drives[i].counts_per_si);
      const Told told = what_was_told(i == 0 ? "127.0.0.1" : "127.0.0.2",
                                      static_cast<std::uint8_t>(backend.drives[i].unit));
      ASSERT_GT(told.speed, 0);
      EXPECT_LE(told.speed, axis.max_speed * counts_per_si + 1);
      EXPECT_LE(told.acceleration, axis.max_acceleration * counts_per_si + 1);
      const double way = std::abs(target.axes[row] - from[row]) * counts_per_si;
      if (way > 1) seconds[i] = travel_time(way, told);
    }
    // Registers hold whole counts per second: the least of these speeds is some 10⁴.
    if (seconds[0] > 0 && seconds[1] > 0) {
      EXPECT_NEAR(seconds[0], seconds[1], 2e-3 * seconds[0]);
    }
    EXPECT_GT(std::max(seconds[0], seconds[1]), 0);
    from = target.axes;
  }
}

}  // namespace
}  // namespace lightrig
