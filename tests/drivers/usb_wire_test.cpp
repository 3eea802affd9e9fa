// The real libusb against a CDC-ACM device that is emulated below the system call interface: our
// USB driver and the GRBL gantry on it. Such a device is seen only by a program that runs under
// umockdev's preload library, so every test runs its own program once more with it.
#include <gmock/gmock.h>

#include <chrono>
#include <functional>
#include <thread>

#include "sim/wire_faults.h"
#include "tests/drivers/umockdev_bed.h"
#include "tests/drivers/wire_rig.h"

namespace lightrig {
namespace {

using namespace std::chrono_literals;
using testing::HasSubstr;

class UsbWire : public testing::Test {
 protected:
  void SetUp() override {
    if (!backends()[1].built) GTEST_SKIP() << "USB and serial are left out of this build";
    rig_ = test::quick_rig();
    for (Axis& axis : rig_.gantry.model.axes)
      axis.home = axis.min + 0.3 * (axis.max - axis.min) + 0.02;  // near where it is parked
    backend_.letters = {'X', 'Y'};
    backend_.units_per_si = {57.29577951308232, 57.29577951308232};
    backend_.endpoint = UsbEndpoint{0x1209, 0x0001, "LIGHTRIG-7", 115200};
    rig_.lamp.backend = GantryLamp{"spindle"};
  }

  /// Runs the body where the emulated device can be seen.
  void inside(const std::function<void()>& body) {
    if (IsSkipped()) return;
    test::in_umockdevs_bed() ? body() : test::pass_in_umockdevs_bed();
  }

  void host() {
    rig_.gantry.backend = backend_;
    world_ = test::world_of(rig_, clock_);
    faults_ = std::make_shared<sim::WireFaults>(world_);
    auto hosted = sim::host_wire(rig_, backend_, world_, faults_);
    ASSERT_TRUE(hosted) << hosted.error().message;
    hosted_ = std::move(*hosted);
  }
  void open() {
    devices_ = {};
    auto opened = open_gantry(rig_, backend_, clock_);
    ASSERT_TRUE(opened) << opened.error().message;
    devices_ = std::move(*opened);
  }
  void host_open_and_home() {
    ASSERT_NO_FATAL_FAILURE(host());
    ASSERT_NO_FATAL_FAILURE(open());
    const auto homed = devices_.gantry->home(soon(20s));
    ASSERT_TRUE(homed) << homed.error().message;
  }
  void strike(const char* fault) {
    const auto parsed = sim::parse_wire_fault(fault);
    ASSERT_TRUE(parsed) << parsed.error().message;
    ASSERT_TRUE(faults_->add(*parsed));
  }
  void expect_well() {
    const auto target = test::at_degrees(-30, 40);
    const auto moved = devices_.gantry->move_to(target, soon(10s));
    ASSERT_TRUE(moved) << moved.error().message;
    EXPECT_LE((world_->gantry_status().position.axes - target.axes).cwiseAbs().maxCoeff(),
              rig_.gantry.model.tolerance);
    const auto lit = devices_.lamp->set(0.5, soon(2s));
    ASSERT_TRUE(lit) << lit.error().message;
    EXPECT_NEAR(world_->lamp_power(), 0.5, 1e-3);
    devices_.lamp.reset();
    EXPECT_EQ(world_->lamp_power(), 0);
  }
  Until soon(std::chrono::milliseconds time) { return {clock_.now() + time, {}}; }
  std::string story() const { return hosted_.front().story(); }

  RealClock clock_;
  Rig rig_;
  GrblGantry backend_;
  std::shared_ptr<sim::World> world_;
  std::shared_ptr<sim::WireFaults> faults_;
  std::vector<sim::HostedWire> hosted_;
  GantryAndLamp devices_;
};

TEST_F(UsbWire, IsFoundByItsNumbersAndSerialConfiguredAndGivenBack) {
  inside([this] {
    ASSERT_NO_FATAL_FAILURE(host_open_and_home());
    // [USB CDC PSTN 1.2, 6.3.10 and 6.3.12]: rate little-endian, 1 stop bit, no parity, 8 bits; DTR
    // and RTS.
    EXPECT_THAT(story(), HasSubstr("line 115200 baud, 8 data bits, parity 0, stop 0\n"));
    EXPECT_THAT(story(), HasSubstr("line state 3\n"));
    EXPECT_THAT(story(), HasSubstr("kernel driver detached from 0\nclaimed 0\n"));
    EXPECT_THAT(story(), HasSubstr("kernel driver detached from 1\nclaimed 1\n"));
    ASSERT_NO_FATAL_FAILURE(expect_well());
    devices_ = {};
    EXPECT_THAT(story(), HasSubstr("released 1\nkernel driver attached to 1\n"));
    EXPECT_THAT(story(), HasSubstr("released 0\nkernel driver attached to 0\n"));
  });
}

TEST_F(UsbWire, AnotherSerialOrAnotherDeviceIsNotTaken) {
  inside([this] {
    ASSERT_NO_FATAL_FAILURE(host());
    auto other = backend_;
    std::get<UsbEndpoint>(other.endpoint).serial = "LIGHTRIG-8";
    const auto wrong = open_gantry(rig_, other, clock_);
    ASSERT_FALSE(wrong);
    EXPECT_EQ(wrong.error().code, ErrorCode::not_found);
    EXPECT_THAT(wrong.error().message, HasSubstr("LIGHTRIG-7")) << "what is there is said";
    std::get<UsbEndpoint>(other.endpoint) = UsbEndpoint{0x1209, 0x0002, "", 115200};
    const auto absent = open_gantry(rig_, other, clock_);
    ASSERT_FALSE(absent);
    EXPECT_EQ(absent.error().code, ErrorCode::not_found);
    EXPECT_THAT(absent.error().message, HasSubstr("1209:0002"));
  });
}

TEST_F(UsbWire, SilenceEndsAtTheDeadlineAndIsOver) {
  inside([this] {
    ASSERT_NO_FATAL_FAILURE(host_open_and_home());
    strike("nak ms=2500");
    std::this_thread::sleep_for(20ms);
    const auto status = devices_.gantry->status(soon(300ms));
    ASSERT_FALSE(status);
    EXPECT_EQ(status.error().code, ErrorCode::timed_out) << status.error().message;
    std::this_thread::sleep_for(2500ms);
    ASSERT_NO_FATAL_FAILURE(expect_well());
  });
}

TEST_F(UsbWire, AStalledEndpointIsSaidAndCleared) {
  inside([this] {
    ASSERT_NO_FATAL_FAILURE(host_open_and_home());
    strike("stall");
    std::this_thread::sleep_for(20ms);
    const auto status = devices_.gantry->status(soon(1s));
    ASSERT_FALSE(status);
    EXPECT_EQ(status.error().code, ErrorCode::disconnected) << status.error().message;
    EXPECT_THAT(story(), HasSubstr("halt cleared at 0x81"));
    // What was lost is unknown: the position is not believed any more.
    EXPECT_EQ(devices_.gantry->move_to(test::at_degrees(0, 40), soon(2s)).error().code,
              ErrorCode::refused);
    ASSERT_TRUE(devices_.gantry->home(soon(20s)));
    ASSERT_NO_FATAL_FAILURE(expect_well());
  });
}

TEST_F(UsbWire, BytesThatComeOneByOneAreALine) {
  inside([this] {
    ASSERT_NO_FATAL_FAILURE(host_open_and_home());
    strike("short_reads count=3");
    for (int i = 0; i < 3; ++i) {
      const auto status = devices_.gantry->status(soon(2s));
      ASSERT_TRUE(status) << status.error().message;
      EXPECT_TRUE(status->homed);
    }
    ASSERT_NO_FATAL_FAILURE(expect_well());
  });
}

// Every transfer that is given up and begun anew is a wait, before every question and command.
TEST_F(UsbWire, OneTransferWaitsForBytesAllTheTime) {
  inside([this] {
    ASSERT_NO_FATAL_FAILURE(host_open_and_home());
    for (int i = 0; i < 5; ++i) ASSERT_TRUE(devices_.gantry->status(soon(2s)));
    ASSERT_NO_FATAL_FAILURE(expect_well());
    EXPECT_THAT(story(), testing::Not(HasSubstr("taken back")));
    devices_ = {};
    EXPECT_THAT(story(), HasSubstr("transfer taken back at 0x81\nreleased 1"));
  });
}

TEST_F(UsbWire, AnUnpluggedDeviceIsGoneAndOneThatIsPluggedInAgainIsWaitedFor) {
  inside([this] {
    ASSERT_NO_FATAL_FAILURE(host_open_and_home());
    strike("unplug ms=2500");
    std::this_thread::sleep_for(20ms);
    const auto begin = std::chrono::steady_clock::now();
    const auto status = devices_.gantry->status(soon(5s));
    ASSERT_FALSE(status);
    EXPECT_EQ(status.error().code, ErrorCode::disconnected) << status.error().message;
    EXPECT_LT(std::chrono::steady_clock::now() - begin, 4s) << "not the deadline's 5 s";
    ASSERT_NO_FATAL_FAILURE(open());  // while it is still away
    const auto again = devices_.gantry->status(soon(2s));
    ASSERT_TRUE(again) << again.error().message;
    EXPECT_FALSE(again->homed) << "a driver opened anew believes no position";
    const auto homed = devices_.gantry->home(soon(20s));
    ASSERT_TRUE(homed) << homed.error().message;
    ASSERT_NO_FATAL_FAILURE(expect_well());
  });
}

TEST_F(UsbWire, AnUnpluggedDeviceEndsAMoveInTime) {
  inside([this] {
    ASSERT_NO_FATAL_FAILURE(host_open_and_home());
    strike("unplug motion=1 delay_ms=80 ms=60000");
    const auto moved = devices_.gantry->move_to(test::at_degrees(150, 80), soon(20s));
    ASSERT_FALSE(moved);
    EXPECT_EQ(moved.error().code, ErrorCode::disconnected) << moved.error().message;
    const auto opened = open_gantry(rig_, backend_, clock_);
    ASSERT_FALSE(opened);
    EXPECT_EQ(opened.error().code, ErrorCode::not_found) << opened.error().message;
  });
}

}  // namespace
}  // namespace lightrig
