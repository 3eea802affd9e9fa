// The simulated camera's control channel byte by byte, as the GigE Vision standard draws it.
#include <arpa/inet.h>
#include <gtest/gtest.h>
#include <netinet/in.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <array>
#include <thread>

#include "tests/drivers/gv_camera_rig.h"

namespace lightrig {
namespace {

using namespace std::chrono_literals;
using Bytes = std::vector<std::uint8_t>;

/// Somebody on the network with a socket.
class Peer {
 public:
  Peer() {
    timeout_.fd = descriptor_;
    timeout_.events = POLLIN;
    sockaddr_in local{};
    local.sin_family = AF_INET;
    inet_pton(AF_INET, "127.0.0.1", &local.sin_addr);
    EXPECT_EQ(bind(descriptor_, reinterpret_cast<sockaddr*>(&local), sizeof local), 0);
    const int on = 1;
    setsockopt(descriptor_, SOL_SOCKET, SO_BROADCAST, &on, sizeof on);
  }
  ~Peer() { close(descriptor_); }
  Peer(const Peer&) = delete;
  Peer& operator=(const Peer&) = delete;

  /// What the camera answers to a datagram; empty when it does not.
  Bytes ask(const Bytes& datagram, const char* address = "127.0.0.1") {
    sockaddr_in to{};
    to.sin_family = AF_INET;
    to.sin_port = htons(3956);
    inet_pton(AF_INET, address, &to.sin_addr);
    sendto(descriptor_, datagram.data(), datagram.size(), 0, reinterpret_cast<sockaddr*>(&to),
           sizeof to);
    if (poll(&timeout_, 1, 500) != 1) return {};
    Bytes answer(2048);
    const ssize_t got = recv(descriptor_, answer.data(), answer.size(), 0);
    answer.resize(got > 0 ? static_cast<std::size_t>(got) : 0);
    return answer;
  }

 private:
  int descriptor_ = socket(AF_INET, SOCK_DGRAM, 0);
  pollfd timeout_{};
};

using GvProtocol = test::GvCameraTest;

const Bytes take_control = {0x42, 0x01, 0x00, 0x82, 0x00, 0x08, 0x00, 0x07,
                            0x00, 0x00, 0x0a, 0x00, 0x00, 0x00, 0x00, 0x02};

TEST_F(GvProtocol, AnswersDiscoveryAskedOfItAloneAndOfEverybody) {
  for (const char* address : {"127.0.0.1", "255.255.255.255"}) {
    Peer peer;
    const Bytes answer = peer.ask({0x42, 0x11, 0x00, 0x02, 0x00, 0x00, 0x00, 0x01}, address);
    ASSERT_EQ(answer.size(), 8U + 0xf8U) << address;
    EXPECT_EQ(Bytes(answer.begin(), answer.begin() + 8),
              (Bytes{0x00, 0x00, 0x00, 0x03, 0x00, 0xf8, 0x00, 0x01}));
    EXPECT_EQ(Bytes(answer.begin() + 8 + 0x24, answer.begin() + 8 + 0x28), (Bytes{127, 0, 0, 1}));
    EXPECT_EQ(std::string(answer.begin() + 8 + 0x48, answer.begin() + 8 + 0x50), "lightrig");
  }
}

TEST_F(GvProtocol, ReadsTwoRegistersInOneCommand) {
  Peer peer;
  // Version 2.0, and the heartbeat of 3000 ms.
  EXPECT_EQ(peer.ask({0x42, 0x01, 0x00, 0x80, 0x00, 0x08, 0x12, 0x34, 0x00, 0x00, 0x00, 0x00, 0x00,
                      0x00, 0x09, 0x38}),
            (Bytes{0x00, 0x00, 0x00, 0x81, 0x00, 0x08, 0x12, 0x34, 0x00, 0x02, 0x00, 0x00, 0x00,
                   0x00, 0x0b, 0xb8}));
}

TEST_F(GvProtocol, SaysWhyItRefuses) {
  Peer peer;
  const auto status = [&](const Bytes& command) {
    const Bytes answer = peer.ask(command);
    return answer.size() < 8 ? -1 : answer[0] << 8 | answer[1];
  };
  const Bytes start = {0x42, 0x01, 0x00, 0x82, 0x00, 0x08, 0x00, 0x09,
                       0x00, 0x00, 0xa0, 0x1c, 0x00, 0x00, 0x00, 0x01};
  EXPECT_EQ(status(start), 0x8006) << "writing without the control privilege";
  EXPECT_EQ(status(take_control), 0);
  EXPECT_EQ(status(start), 0);
  const auto read = [](std::uint8_t high, std::uint8_t low) {
    return Bytes{0x42, 0x01, 0x00, 0x80, 0x00, 0x04, 0x00, 0x08, 0x00, 0x00, high, low};
  };
  EXPECT_EQ(status(read(0x00, 0x02)), 0x8005) << "an address between words";
  EXPECT_EQ(status(read(0xff, 0x00)), 0x8003) << "an address where nothing is";
  EXPECT_EQ(status({0x42, 0x01, 0x00, 0x82, 0x00, 0x08, 0x00, 0x0a, 0x00, 0x00, 0x00, 0x00, 0x00,
                    0x00, 0x00, 0x01}),
            0x8004)
      << "the version cannot be written";
  EXPECT_EQ(status({0x42, 0x01, 0x00, 0x82, 0x00, 0x08, 0x00, 0x0b, 0x00, 0x00, 0xa0, 0x00, 0x00,
                    0x00, 0x00, 0x01}),
            0x8002)
      << "the sensor's width is what it is";
  EXPECT_EQ(status({0x42, 0x01, 0x01, 0x00, 0x00, 0x00, 0x00, 0x0c}), 0x8001)
      << "an action command, which it does not know";
  EXPECT_TRUE(peer.ask({0x41, 0x01, 0x00, 0x80, 0x00, 0x04, 0x00, 0x08, 0, 0, 0, 0}).empty())
      << "no command at all";
}

TEST_F(GvProtocol, AControllerThatFallsSilentLosesTheCamera) {
  Peer silent;
  ASSERT_EQ(silent.ask(take_control).size(), 12U);
  // Heartbeat of 600 ms.
  ASSERT_EQ(silent
                .ask({0x42, 0x01, 0x00, 0x82, 0x00, 0x08, 0x00, 0x09, 0x00, 0x00, 0x09, 0x38, 0x00,
                      0x00, 0x02, 0x58})
                .at(0),
            0x00);
  Peer waiting;
  EXPECT_EQ(waiting.ask(take_control).at(0), 0x80) << "it is in other hands";
  std::this_thread::sleep_for(800ms);
  EXPECT_EQ(waiting.ask(take_control).at(0), 0x00) << "its controller said nothing for too long";
  EXPECT_EQ(silent.ask(take_control).at(0), 0x80);
}

}  // namespace
}  // namespace lightrig
