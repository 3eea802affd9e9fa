// Our Modbus client and our simulated controller against independent peers, pymodbus and mbpoll:
// TCP and RTU, both orders of words.
#include <fcntl.h>
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <poll.h>
#include <pty.h>
#include <termios.h>
#include <unistd.h>

#include <array>
#include <chrono>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <sstream>
#include <thread>

#include "tests/drivers/child_process.h"
#include "tests/drivers/own_network.h"
#include "tests/drivers/wire_rig.h"
#include "tests/paths.h"

namespace lightrig {
namespace {

namespace fs = std::filesystem;
using namespace std::chrono_literals;
using testing::HasSubstr;

constexpr int tcp_port = 1502;

struct Peering {
  bool tcp = true;
  std::string order;  ///< "high" or "low"
};

/// Two ptys with a cable between them.
class NullModem {
 public:
  NullModem() {
    for (End& end : ends_) {
      termios raw{};
      cfmakeraw(&raw);
      std::array<char, 128> name{};
      if (openpty(&end.master, &end.slave, name.data(), &raw, nullptr) != 0) std::abort();
      end.name = name.data();
    }
    relay_ = std::jthread([this](const std::stop_token& stop) { relay(stop); });
  }
  ~NullModem() {
    relay_.request_stop();
    relay_.join();
    for (const End& end : ends_) {
      close(end.master);
      close(end.slave);
    }
  }
  NullModem(const NullModem&) = delete;
  NullModem& operator=(const NullModem&) = delete;
  const std::string& name(std::size_t i) const { return ends_[i].name; }

 private:
  struct End {
    int master = -1, slave = -1;
    std::string name;
  };
  void relay(const std::stop_token& stop) {
    while (!stop.stop_requested()) {
      std::array<pollfd, 2> watch{pollfd{ends_[0].master, POLLIN, 0},
                                  pollfd{ends_[1].master, POLLIN, 0}};
      poll(watch.data(), watch.size(), 50);
      for (std::size_t i = 0; i < 2; ++i) {
        if ((watch[i].revents & POLLIN) == 0) continue;
        std::array<char, 512> buffer{};
        const ssize_t got = read(ends_[i].master, buffer.data(), buffer.size());
        if (got > 0)
          (void)!write(ends_[1 - i].master, buffer.data(), static_cast<std::size_t>(got));
      }
    }
  }

  std::array<End, 2> ends_;
  std::jthread relay_;
};

std::string output_of(const std::string& command, int& code) {
  FILE* pipe = popen((command + " 2>&1").c_str(), "r");
  std::string out;
  std::array<char, 4096> buffer{};
  for (std::size_t n = 0; (n = std::fread(buffer.data(), 1, buffer.size(), pipe)) > 0;)
    out.append(buffer.data(), n);
  const int status = pclose(pipe);
  code = WIFEXITED(status) ? WEXITSTATUS(status) : -1;
  return out;
}

class ModbusPeer : public testing::TestWithParam<Peering>, protected test::ModbusLab {
 protected:
  void SetUp() override {
    if (!backends().front().built) GTEST_SKIP() << "Modbus is left out of this build";
    const std::string obstacle = test::enter_own_network();
    if (!obstacle.empty()) GTEST_SKIP() << obstacle;
    backend_.timeout = 300ms;
    const fs::path path = fs::path(lightrig::test::source_dir) / "config/controllers/generic.toml";
    std::stringstream text;
    text << std::ifstream(path).rdbuf();
    std::string profile = text.str();
    if (GetParam().order == "low")
      profile.replace(profile.find("\"high_first\""), 12, "\"low_first\"");
    const auto read = read_profile_text(profile, path);
    ASSERT_TRUE(read.value);
    backend_.controller = *read.value;
  }

  void connect_to(const std::string& device) {
    SerialEndpoint serial;
    serial.device = device;
    if (GetParam().tcp)
      connect(TcpEndpoint{"127.0.0.1", tcp_port});
    else
      connect(serial);
  }
  static std::string peer(const std::string& file) {
    return (fs::path(lightrig::test::source_dir) / "tests/drivers/peers" / file).string();
  }
};

TEST_P(ModbusPeer, OurGantryMovesDrivesThatPymodbusServes) {
  NullModem cable;
  connect_to(cable.name(0));
  const fs::path said = fs::path(testing::TempDir()) / fmt::format("pymodbus_{}", getpid());
  const std::string where = GetParam().tcp ? std::to_string(tcp_port) : cable.name(1);
  test::ChildProcess server(
      {"/bin/sh", "-c",
       fmt::format("exec /usr/bin/python3 {} {} {} {} > {} 2>&1", peer("pymodbus_drive.py"),
                   GetParam().tcp ? "tcp" : "rtu", where, GetParam().order, said.string())});
  // Python takes a second to be there.
  Result<GantryAndLamp> opened = open();
  for (int attempt = 0; attempt < 60 && !opened; ++attempt) {
    std::this_thread::sleep_for(100ms);
    opened = open();
  }
  ASSERT_TRUE(opened) << opened.error().message << "\n" << std::ifstream(said).rdbuf();
  const auto homed = opened->gantry->home(soon(10s));
  ASSERT_TRUE(homed) << homed.error().message;
  const GantryPosition target = test::at_degrees(-60, 70.25);
  const auto moved = opened->gantry->move_to(target, soon(10s));
  ASSERT_TRUE(moved) << moved.error().message;
  const auto status = opened->gantry->status(soon(2s));
  ASSERT_TRUE(status) << status.error().message;
  EXPECT_TRUE(status->homed);
  EXPECT_LT((status->position.axes - target.axes).cwiseAbs().maxCoeff(), 1e-5);
  // What the peer understood, in counts: a thousand a degree.
  std::stringstream log;
  log << std::ifstream(said).rdbuf();
  EXPECT_THAT(log.str(), HasSubstr("unit 1 at -60000\n"));
  EXPECT_THAT(log.str(), HasSubstr("unit 2 at 70250\n"));
  fs::remove(said);
}

TEST_P(ModbusPeer, PymodbusMovesTheDrivesThatWeServe) {
  const std::string device = fmt::format("{}lightrig_peer_{}", testing::TempDir(), getpid());
  connect_to(device);
  ASSERT_NO_FATAL_FAILURE(host());
  int code = -1;
  const std::string out =
      output_of(fmt::format("timeout 60 /usr/bin/python3 {} {} {} {} -60000 70250",
                            peer("pymodbus_client.py"), GetParam().tcp ? "tcp" : "rtu",
                            GetParam().tcp ? std::to_string(tcp_port) : device, GetParam().order),
                code);
  EXPECT_EQ(code, 0) << out;
  EXPECT_THAT(out, HasSubstr("unit 1 at -60000\nunit 2 at 70250\nlamp 500\n"));
  const GantryPosition target = test::at_degrees(-60, 70.25);
  EXPECT_LT((world_->gantry_status().position.axes - target.axes).cwiseAbs().maxCoeff(), 1e-5);
  EXPECT_DOUBLE_EQ(world_->lamp_power(), 0.5);
}

TEST_P(ModbusPeer, MbpollReadsAndWritesWhatWeServe) {
  const std::string device = fmt::format("{}lightrig_peer_{}", testing::TempDir(), getpid());
  connect_to(device);
  ASSERT_NO_FATAL_FAILURE(host());
  const std::string line = GetParam().tcp ? fmt::format("-m tcp -p {} 127.0.0.1", tcp_port)
                                          : fmt::format("-m rtu -b 115200 -P none {}", device);
  const auto mbpoll = [&](const std::string& what, const std::string& values = "") {
    int code = -1;
    std::string out =
        output_of(fmt::format("timeout 20 mbpoll -q -0 -1 {} {} {}", what, line, values), code);
    EXPECT_EQ(code, 0) << out;
    return out;
  };
  EXPECT_THAT(mbpoll("-a 2 -t 4 -r 0 -c 1"), HasSubstr("19538"));  // 0x4C52
  // Parked at min + 0.3 · (max − min): −68° of ±170°, 29.9° of 5° … 88°.
  const std::string words = GetParam().order == "high" ? "-B " : "";
  EXPECT_THAT(mbpoll("-a 1 -t 4:int -r 512 -c 1 " + words), HasSubstr("-68000"));
  EXPECT_THAT(mbpoll("-a 2 -t 4:int -r 512 -c 1 " + words), HasSubstr("29900"));
  mbpoll("-a 1 -t 4 -r 768", "250");
  EXPECT_DOUBLE_EQ(world_->lamp_power(), 0.25);
  int code = 0;
  EXPECT_THAT(
      output_of(fmt::format("timeout 20 mbpoll -q -0 -1 -a 1 -t 4 -r 20480 -c 1 {}", line), code),
      HasSubstr("Illegal data address"));
}

INSTANTIATE_TEST_SUITE_P(Peers, ModbusPeer,
                         testing::Values(Peering{true, "high"}, Peering{true, "low"},
                                         Peering{false, "high"}, Peering{false, "low"}),
                         [](const auto& peering) {
                           return std::string(peering.param.tcp ? "Tcp" : "Rtu") +
                                  (peering.param.order == "high" ? "HighWordFirst"
                                                                 : "LowWordFirst");
                         });

}  // namespace
}  // namespace lightrig
