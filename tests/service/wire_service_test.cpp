// The service over wires: ABORT against a camera that blocks, and the lamp's lease where the lamp
// itself knows of none. The rig is at the far end of its wires, in this process; the service takes
// it for a real one.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <chrono>
#include <filesystem>
#include <fstream>
#include <functional>
#include <thread>

#include "config/read_rig.h"
#include "daemon/service/service.h"
#include "sim/hosted_rig.h"
#include "sim/world.h"
#include "tests/drivers/own_network.h"
#include "tests/service/scratch_folder.h"
#include "tests/wire/small_wire_rig.h"

namespace lightrig {
namespace {

using namespace std::chrono_literals;
using std::chrono::steady_clock;

const Caller person{"person", "in process"};

class ServiceOverWires : public testing::Test {
 protected:
  void SetUp() override {
    for (const Backend& backend : backends())
      if (!backend.built) GTEST_SKIP() << backend.name << " is left out of this build";
    if (const std::string obstacle = test::enter_own_network(); !obstacle.empty())
      GTEST_SKIP() << obstacle;
    test::SmallWireRig text("wire_modbus_tcp.toml");
    text.sessions_in(folder_.path() / "sessions");
    text.set("max_exposure_s", "0.5");
    text.set("max_on_time_s", "1.5");
    shape(text);
    const std::filesystem::path file = folder_.path() / "rig.toml";
    std::ofstream(file) << text.text();
    auto read = read_rig(file);
    for (const Diagnostic& one : read.diagnostics)
      if (one.severity == Diagnostic::Severity::error) ADD_FAILURE() << to_text(one, read.text);
    ASSERT_TRUE(read.value);
    rig_ = std::move(*read.value);
    auto hosted = sim::host_rig(rig_, rig_.session_defaults.object, 1);
    ASSERT_TRUE(hosted) << hosted.error().message;
    hosted_ = std::make_unique<sim::HostedRig>(std::move(*hosted));
    service_ = std::make_unique<Service>(ServiceSettings{rig_, false, 1, 1}, log_, hub_, liveness_);
    ASSERT_TRUE(service_->arm(person));
    ASSERT_TRUE(wait_until([this] { return service_->snapshot().state == State::armed; }));
  }

  virtual void shape(test::SmallWireRig&) {}
  bool wait_until(const std::function<bool()>& good) const {
    const auto end = steady_clock::now() + 60s;
    while (!good() && steady_clock::now() < end) std::this_thread::sleep_for(2ms);
    return good();
  }
  void start_a_session_and_wait_for_its_lamp() {
    const auto spec = read_session({}, rig_);
    ASSERT_TRUE(spec.value);
    ASSERT_TRUE(service_->start(person, {*spec.value, {}, ""}));
    ASSERT_TRUE(wait_until([this] { return lamp_power() > 0; })) << activity();
  }
  double lamp_power() const { return hosted_->world->lamp_power(); }
  std::string activity() const {
    const Snapshot now = service_->snapshot();
    return now.session ? now.session->progress.activity : "";
  }

  ScratchFolder folder_;
  Rig rig_;
  std::unique_ptr<sim::HostedRig> hosted_;
  Log log_{LogLevel::info, Log::Sink::none};
  EventHub hub_;
  Liveness liveness_;
  std::unique_ptr<Service> service_;
};

// Every register call to a camera that does not answer blocks for seconds, and so does opening it
// anew. None of that may keep ABORT: neither from taking effect, nor the session from ending.
TEST_F(ServiceOverWires, AbortDoesNotWaitForACameraThatIsDeadOrBeingOpenedAgain) {
  ASSERT_NO_FATAL_FAILURE(start_a_session_and_wait_for_its_lamp());
  ASSERT_TRUE(hosted_->add_fault("frozen seconds=600"));
  // The journal says so when the session begins to open the devices again.
  std::filesystem::path journal;
  ASSERT_TRUE(wait_until([&] {
    const Snapshot now = service_->snapshot();
    if (now.session) journal = now.session->folder / "journal.jsonl";
    std::ifstream in(journal);
    const std::string text{std::istreambuf_iterator<char>(in), {}};
    return text.find("\"remedy\":\"reopen\"") != std::string::npos;
  }));
  std::this_thread::sleep_for(500ms);  // into the old camera's end, or the new one's opening
  const auto asked = steady_clock::now();
  service_->abort(person, "by test");
  EXPECT_EQ(service_->snapshot().state, State::aborted);
  ASSERT_TRUE(wait_until([this] {
    const Snapshot now = service_->snapshot();
    return now.session && now.session->state == "aborted" && !now.busy;
  })) << activity();
  // A register of a dead camera takes 2.5 s, its opening longer; the rest is slack for a loaded
  // machine.
  EXPECT_LT(steady_clock::now() - asked, 2s);
  EXPECT_EQ(lamp_power(), 0);
  EXPECT_TRUE(hosted_->world->gantry_status().at_rest);
  EXPECT_FALSE(service_->snapshot().lamp_may_be_on);
}

// Drives that answer nothing take every question to its time-out, half a second each; the stop
// command goes out all the same, and what nobody confirmed is not called dark.
TEST_F(ServiceOverWires, AbortDoesNotWaitForAControllerThatIsSilentAndSaysThatTheLampMayBeOn) {
  ASSERT_NO_FATAL_FAILURE(start_a_session_and_wait_for_its_lamp());
  ASSERT_TRUE(hosted_->add_fault("silence count=1000000"));
  std::this_thread::sleep_for(200ms);  // into a call that waits for its answer
  const auto asked = steady_clock::now();
  service_->abort(person, "by test");
  const auto answered = steady_clock::now() - asked;
  EXPECT_EQ(service_->snapshot().state, State::aborted);
  ASSERT_TRUE(wait_until([this] { return !service_->snapshot().busy; })) << activity();
  const auto ended = steady_clock::now() - asked;
  EXPECT_LT(answered, 450ms);  // less than one time-out
  EXPECT_LT(ended, 20s);
  EXPECT_TRUE(service_->snapshot().lamp_may_be_on);
  const Snapshot now = service_->snapshot();
  ASSERT_TRUE(now.session);
  // A fault on top of the abort: nobody confirmed that the lamp is dark.
  EXPECT_EQ(now.session->state, "faulted");
}

TEST_F(ServiceOverWires, ALampThatAPersonLeftOnGoesDarkWhenItsLeaseEnds) {
  const auto lit = steady_clock::now();
  ASSERT_TRUE(service_->lamp(person, 1));
  ASSERT_TRUE(wait_until([this] { return lamp_power() > 0; }));
  ASSERT_TRUE(wait_until([this] { return lamp_power() == 0; }));
  EXPECT_GE(steady_clock::now() - lit, 1500ms);
  EXPECT_LT(steady_clock::now() - lit, 10s);
  EXPECT_EQ(service_->snapshot().state, State::armed);
  EXPECT_FALSE(service_->snapshot().lamp_may_be_on);
}

// While the gantry moves nobody heeds a lease.
class ServiceOfASlowJog : public ServiceOverWires {
  void shape(test::SmallWireRig& text) override {
    text.set("max_speed_deg_per_s", "10");
    text.set("max_on_time_s", "6");
  }

 protected:
  /// The brightest that the lamp was on the way there.
  double brightest_on_the_way_to(double degrees) {
    EXPECT_TRUE(service_->jog(person, "azimuth", degrees * 0.017453292519943295, false));
    double brightest = 0;
    wait_until([&] {
      if (!hosted_->world->gantry_status().at_rest) brightest = std::max(brightest, lamp_power());
      return !service_->snapshot().busy;
    });
    EXPECT_EQ(service_->snapshot().commands.back().state, "done")
        << service_->snapshot().commands.back().message;
    return brightest;
  }
};

TEST_F(ServiceOfASlowJog, AJogThatMayOutlastTheLampsLeaseIsDrivenInTheDark) {
  const auto idle = [this] { return !service_->snapshot().busy; };
  ASSERT_TRUE(service_->home(person));
  ASSERT_TRUE(wait_until(idle));
  ASSERT_TRUE(service_->lamp(person, 1));
  ASSERT_TRUE(wait_until([&] { return idle() && lamp_power() > 0; }));
  // By 3° it is there long before; by 40° it takes 4 s, and may take half as long again and more.
  EXPECT_GT(brightest_on_the_way_to(3), 0);
  EXPECT_EQ(brightest_on_the_way_to(43), 0);
  EXPECT_THAT(service_->snapshot().commands.back().message,
              ::testing::HasSubstr("the lamp was made dark first"));
  EXPECT_EQ(lamp_power(), 0);
  EXPECT_EQ(service_->snapshot().state, State::armed);
}

// The stop that an ABORT sends brakes the arm for a while, and nothing keeps a person from arming
// meanwhile.
class ServiceOfASlowArm : public ServiceOverWires {
  void shape(test::SmallWireRig& text) override {
    text.set("max_speed_deg_per_s", "100");
    text.set("max_acceleration_deg_per_s2", "30");
  }
};

TEST_F(ServiceOfASlowArm, ArmedWhileTheArmStillBrakesItWaitsForRestAndNothingLooksLikeAFault) {
  const auto at_rest = [this] { return hosted_->world->gantry_status().at_rest; };
  const auto idle = [this] { return !service_->snapshot().busy; };
  ASSERT_TRUE(service_->home(person));
  ASSERT_TRUE(wait_until(idle));
  ASSERT_TRUE(service_->jog(person, "azimuth", 160 * 0.017453292519943295, false, ""));
  ASSERT_TRUE(wait_until([&] { return !at_rest(); }));
  std::this_thread::sleep_for(1800ms);  // up to a speed that takes as long to lose
  service_->abort(person, "by test");
  ASSERT_TRUE(wait_until([&] { return idle() && !service_->snapshot().facts; }));
  ASSERT_FALSE(at_rest()) << "braked too fast to see anything";
  ASSERT_TRUE(service_->arm(person));
  ASSERT_TRUE(wait_until([this] { return service_->snapshot().state == State::armed; }));
  EXPECT_TRUE(at_rest());
  EXPECT_TRUE(service_->snapshot().facts->gantry.at_rest);
}

// The camera is asked whether it is there, opened or not; what is found is dated.
TEST_F(ServiceOverWires, TellsWhetherTheCameraIsThere) {
  const auto camera = [this] {
    for (const DeviceLook& one : service_->snapshot().self_test)
      if (one.device == "camera 127.0.0.1") return one;
    return DeviceLook{};
  };
  service_->look_at_devices();  // armed: the session thread holds the camera
  EXPECT_TRUE(camera().good);
  EXPECT_THAT(camera().said, ::testing::HasSubstr("answers discovery at 127.0.0.1"));
  ASSERT_TRUE(service_->disarm(person));
  ASSERT_TRUE(wait_until([this] {
    const Snapshot now = service_->snapshot();
    return now.state == State::unarmed && !now.busy && !now.facts;
  }));
  service_->look_at_devices();
  EXPECT_TRUE(camera().good) << camera().said;
  EXPECT_GE(camera().age_s, 0);
  EXPECT_LT(camera().age_s, 60);
  hosted_.reset();  // unplugged, all of it
  service_->look_at_devices();
  EXPECT_FALSE(camera().good);
  const auto why = [this] { return ::testing::PrintToString(service_->snapshot().why_not_ready); };
  EXPECT_THAT(why(), ::testing::HasSubstr("camera 127.0.0.1: it does not answer discovery"));
  ASSERT_TRUE(service_->arm(person));
  ASSERT_TRUE(wait_until([this] { return !service_->snapshot().busy; }));
  EXPECT_THAT(why(), ::testing::HasSubstr("opening: ")) << "why it could not be armed stays known";
}

}  // namespace
}  // namespace lightrig
