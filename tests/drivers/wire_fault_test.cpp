// Each fault on each wire of the gantry, with its stated outcome: what the driver says of it, how
// the drives are left, and that it is over when it is over.
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <unistd.h>

#include <atomic>
#include <chrono>
#include <mutex>
#include <thread>

#include "sim/hosted_rig.h"
#include "sim/memory_devices.h"
#include "tests/drivers/own_network.h"
#include "tests/drivers/umockdev_bed.h"
#include "tests/drivers/wire_rig.h"

namespace lightrig {
namespace {

using namespace std::chrono_literals;

enum class Wired { tcp, rtu, grbl, usb, lamp };
/// What is being done when the fault strikes.
enum class Doing { status, move, lamp_on };
/// How the rig is afterwards.
enum class After {
  well,      ///< the next call of every kind succeeds
  reopened,  ///< well, once the devices are opened anew
  rehomed,   ///< well, once homed again
  cleared,   ///< well, once the fault is cleared, and homed again where home was lost
  closed,    ///< well, once the interlock is closed
};

struct Case {
  Wired wire;
  std::string fault;
  Doing doing;
  std::optional<ErrorCode> said;  ///< empty: nothing goes wrong that a caller would see
  std::string words;              ///< in the message
  After after;
};

std::string wire_name(Wired wire) {
  switch (wire) {
    case Wired::tcp:
      return "Tcp";
    case Wired::rtu:
      return "Rtu";
    case Wired::grbl:
      return "Grbl";
    case Wired::usb:
      return "Usb";
    case Wired::lamp:
      return "Lamp";
  }
  return "";
}

/// One case on a rig of its own. The cases of a wire run side by side, each mostly waiting.
class FaultStory {
 public:
  FaultStory(const Case& c, std::size_t number, const Rig& rig) : case_(c), rig_(rig) {
    SerialEndpoint serial;
    serial.device = fmt::format("{}lightrig_fault_{}_{}", testing::TempDir(), getpid(), number);
    if (c.wire == Wired::lamp) {
      rig_.gantry.backend = SimulatedGantry{};
      rig_.lamp.backend = GrblLamp{serial, "spindle"};
    } else if (c.wire == Wired::grbl || c.wire == Wired::usb) {
      GrblGantry backend;
      backend.letters = {'X', 'Y'};
      backend.units_per_si = {57.29577951308232, 57.29577951308232};
      backend.endpoint = serial;
      if (c.wire == Wired::usb) backend.endpoint = UsbEndpoint{0x1209, 0x0001, "FAULTS", 115200};
      rig_.lamp.backend = GantryLamp{"spindle"};
      rig_.gantry.backend = backend;
    } else {
      auto backend = std::get<ModbusGantry>(rig_.gantry.backend);
      backend.timeout = 400ms;  // ample on a loaded machine
      // A serial line recovers by silence, a flush and two reads in step: some five timeouts. The
      // drives' watchdog must leave time for that, as docs/hardware.md asks of a rig.
      if (c.wire == Wired::rtu) backend.controller.watchdog->timeout = 6s;
      for (ModbusDrive& drive : backend.drives) {
        if (c.wire == Wired::tcp)
          drive.endpoint = TcpEndpoint{"127.0.0.1", 1502 + static_cast<int>(number)};
        else
          drive.endpoint = serial;
      }
      rig_.gantry.backend = backend;
    }
  }

  /// "" or what was not as it should be.
  std::string run() {
    if (auto ready = prepare(); !ready) return "before the fault: " + ready.error().message;
    const auto fault = sim::parse_wire_fault(case_.fault);
    if (!fault) return fault.error().message;
    if (auto added = faults_->add(*fault); !added) return added.error().message;
    const auto done = act();
    if (std::string wrong = judge(done); !wrong.empty()) return wrong;
    if (auto mended = mend(); !mended) return "afterwards: " + mended.error().message;
    if (faults_->struck().empty()) return "the fault never struck";
    if (!world_->gantry_status().at_rest) return "the drives are still moving";
    auto well = works_again();
    return well ? std::string() : "and then: " + well.error().message;
  }

 private:
  Result<void> prepare() {
    world_ = test::world_of(rig_, clock_);
    faults_ = std::make_shared<sim::WireFaults>(world_);
    auto hosted = [&]() -> Result<std::vector<sim::HostedWire>> {
      if (const auto* modbus = std::get_if<ModbusGantry>(&rig_.gantry.backend))
        return sim::host_wire(rig_, *modbus, world_, faults_);
      if (const auto* lamp = std::get_if<GrblLamp>(&rig_.lamp.backend))
        return sim::host_wire(rig_, *lamp, world_, faults_);
      return sim::host_wire(rig_, std::get<GrblGantry>(rig_.gantry.backend), world_, faults_);
    }();
    if (!hosted) return tl::unexpected(hosted.error());
    hosted_ = std::move(*hosted);
    if (auto opened = open(); !opened) return opened;
    return devices_.gantry->home(soon(20s));
  }

  Result<void> open() {
    devices_ = {};
    auto opened = [&]() -> Result<GantryAndLamp> {
      if (const auto* own = std::get_if<GrblLamp>(&rig_.lamp.backend)) {
        auto lamp = open_lamp(rig_, *own, clock_);
        if (!lamp) return tl::unexpected(lamp.error());
        return GantryAndLamp{sim::make_gantry(world_), std::move(*lamp)};
      }
      if (const auto* modbus = std::get_if<ModbusGantry>(&rig_.gantry.backend))
        return open_gantry(rig_, *modbus, clock_);
      return open_gantry(rig_, std::get<GrblGantry>(rig_.gantry.backend), clock_);
    }();
    if (!opened) return tl::unexpected(opened.error());
    devices_ = std::move(*opened);
    return {};
  }

  Until soon(std::chrono::milliseconds time) { return {clock_.now() + time, {}}; }

  /// The first failure of what is being done; looks at the status a few times, as a session would.
  Result<void> act() {
    switch (case_.doing) {
      case Doing::status:
        for (int look = 0; look < 4 && case_.wire == Wired::lamp; ++look) {
          std::this_thread::sleep_for(10ms);
          if (auto state = devices_.lamp->state(soon(2s)); !state)
            return tl::unexpected(state.error());
        }
        for (int look = 0; look < 4; ++look) {
          std::this_thread::sleep_for(10ms);  // the far end carries out what is due
          if (auto status = devices_.gantry->status(soon(2s)); !status)
            return tl::unexpected(status.error());
        }
        return {};
      case Doing::move:
        return devices_.gantry->move_to(test::at_degrees(0, 50), soon(2s));
      case Doing::lamp_on:
        return devices_.lamp->set(1, soon(2s));
    }
    return {};
  }

  std::string judge(const Result<void>& done) const {
    if (!case_.said) return done ? "" : "it should have passed unseen: " + done.error().message;
    if (!done && done.error().code == *case_.said &&
        done.error().message.find(case_.words) != std::string::npos)
      return "";
    if (done) return "nothing was said of it";
    return fmt::format("it should have been {} with \"{}\", not {}: {}",
                       lightrig::name_of(*case_.said), case_.words,
                       lightrig::name_of(done.error().code), done.error().message);
  }

  /// What a person or a session does before going on.
  Result<void> mend() {
    std::this_thread::sleep_for(900ms);  // every fault of these cases is over by then
    if (case_.after == After::reopened)
      if (auto opened = open(); !opened) return opened;
    if (case_.after == After::closed) {
      world_->set_interlock("door", false);
      world_->set_interlock("e_stop", false);
    }
    if (case_.after == After::cleared)
      if (auto cleared = devices_.gantry->clear_fault(soon(3s)); !cleared) return cleared;
    const auto status = devices_.gantry->status(soon(3s));
    if (!status) return tl::unexpected(status.error());
    if (case_.after == After::rehomed && status->homed)
      return fail(ErrorCode::refused, "a lost position is believed");
    if (case_.after == After::well && !status->homed)
      return fail(ErrorCode::refused, "the position was lost for nothing");
    return status->homed ? Result<void>{} : devices_.gantry->home(soon(20s));
  }

  /// It moves, reads its true position, lights, and goes dark with its owner.
  Result<void> works_again() {
    if (auto moved = devices_.gantry->move_to(test::at_degrees(-30, 30), soon(8s)); !moved)
      return moved;
    const auto status = devices_.gantry->status(soon(2s));
    if (!status) return tl::unexpected(status.error());
    const AxisValues off = status->position.axes - world_->gantry_status().position.axes;
    if (!(off.cwiseAbs().maxCoeff() <= rig_.gantry.model.tolerance))
      return fail(ErrorCode::refused, "the position read is not the drives'");
    if (auto lit = devices_.lamp->set(1, soon(2s)); !lit) return lit;
    if (world_->lamp_power() != 1) return fail(ErrorCode::refused, "the lamp is not lit");
    devices_.lamp.reset();
    if (world_->lamp_power() != 0) return fail(ErrorCode::refused, "the lamp is not dark");
    return {};
  }

  const Case& case_;
  RealClock clock_;
  Rig rig_;
  std::shared_ptr<sim::World> world_;
  std::shared_ptr<sim::WireFaults> faults_;
  std::vector<sim::HostedWire> hosted_;
  GantryAndLamp devices_;
};

using enum Wired;
using enum Doing;
using enum After;
constexpr auto timed_out = ErrorCode::timed_out;
constexpr auto refused = ErrorCode::refused;
constexpr auto disconnected = ErrorCode::disconnected;

const std::vector<Case> cases{
    // Answers. What was not answered has failed; a motion write is never repeated by the driver.
    {tcp, "silence", status, timed_out, "read", well},
    {tcp, "silence", move, timed_out, "", well},
    {tcp, "lost_answer request=5", move, timed_out, "", well},
    {tcp, "exception", status, timed_out, "Slave device or server failure", well},
    {tcp, "exception code=2 request=2", status, refused, "Illegal data address", well},
    {tcp, "late ms=800", status, timed_out, "", well},
    {tcp, "duplicate request=2", status, timed_out, "", well},
    {tcp, "wrong_id", status, timed_out, "", well},
    {tcp, "truncated", status, timed_out, "", well},
    {tcp, "corrupted", status, timed_out, "", well},
    {tcp, "short_reads", status, std::nullopt, "", well},
    {tcp, "silence", lamp_on, timed_out, "switch the lamp", well},
    {tcp, "lost_answer", lamp_on, timed_out, "switch the lamp", well},
    {rtu, "silence", status, timed_out, "", well},
    {rtu, "silence request=5", move, timed_out, "", well},
    {rtu, "lost_answer request=6", move, timed_out, "", well},
    {rtu, "exception code=4", status, timed_out, "Slave device or server failure", well},
    {rtu, "late ms=800", status, timed_out, "", well},
    {rtu, "duplicate", status, std::nullopt, "", well},
    {rtu, "wrong_id", status, timed_out, "", well},
    {rtu, "truncated", status, timed_out, "", well},
    {rtu, "corrupted", status, timed_out, "", well},
    {rtu, "short_reads", status, std::nullopt, "", well},
    {rtu, "silence", lamp_on, timed_out, "switch the lamp", well},
    // A status report that does not come is asked for again.
    {grbl, "silence", status, std::nullopt, "", well},
    {grbl, "silence count=10", status, timed_out, "no status report", well},
    {grbl, "lost_answer request=5", move, std::nullopt, "", well},
    {grbl, "lost_answer request=3", move, timed_out, "no answer", well},
    {grbl, "duplicate", status, std::nullopt, "", well},
    {grbl, "duplicate request=3", move, std::nullopt, "", well},
    {grbl, "silence request=3", move, timed_out, "no answer", well},
    {grbl, "garbled_request request=3", move, timed_out, "from the target", well},
    {grbl, "exception request=3", move, refused, "error:9", well},
    {grbl, "late ms=300", status, std::nullopt, "", well},
    {grbl, "truncated", status, std::nullopt, "", well},
    {grbl, "corrupted", status, std::nullopt, "", well},
    {grbl, "short_reads", status, std::nullopt, "", well},
    {grbl, "silence request=2", lamp_on, timed_out, "no answer", well},
    {grbl, "lost_answer request=2", lamp_on, timed_out, "no answer", well},
    {grbl, "garbled_request request=2", lamp_on, timed_out, "asked for S1000", well},
    {usb, "silence", status, std::nullopt, "", well},
    {usb, "lost_answer request=5", move, std::nullopt, "", well},
    {usb, "lost_answer request=3", move, timed_out, "no answer", well},
    {usb, "garbled_request request=3", move, timed_out, "from the target", well},
    {usb, "exception request=3", move, refused, "error:9", well},
    {usb, "late ms=300", status, std::nullopt, "", well},
    {usb, "duplicate", status, std::nullopt, "", well},
    {usb, "truncated", status, std::nullopt, "", well},
    {usb, "corrupted", status, std::nullopt, "", well},
    {usb, "short_reads count=3", status, std::nullopt, "", well},
    {usb, "nak ms=600", move, timed_out, "", well},
    {lamp, "silence wire=lamp", status, std::nullopt, "", well},
    {lamp, "silence wire=lamp count=10", status, timed_out, "no status report", well},
    {lamp, "lost_answer wire=lamp request=2", lamp_on, timed_out, "no answer", well},
    {lamp, "silence wire=lamp request=2", lamp_on, timed_out, "no answer", well},
    {lamp, "garbled_request wire=lamp request=2", lamp_on, timed_out, "asked for S1000", well},
    {lamp, "exception wire=lamp request=2", lamp_on, refused, "error:9", well},
    {lamp, "duplicate wire=lamp", status, std::nullopt, "", well},
    {lamp, "late wire=lamp ms=300", status, std::nullopt, "", well},
    {lamp, "truncated wire=lamp", status, std::nullopt, "", well},
    {lamp, "corrupted wire=lamp", status, std::nullopt, "", well},
    {lamp, "short_reads wire=lamp", status, std::nullopt, "", well},
    // Wires.
    {tcp, "closed", status, disconnected, "", well},
    {tcp, "closed request=5", move, disconnected, "", well},
    {tcp, "half_open", status, timed_out, "", well},
    {tcp, "unplug ms=300", status, disconnected, "", well},
    {rtu, "unplug ms=300", status, disconnected, "", well},
    {grbl, "unplug ms=300", status, disconnected, "", reopened},
    {usb, "unplug ms=300", status, disconnected, "", reopened},
    {usb, "stall", status, disconnected, "", rehomed},
    {lamp, "unplug wire=lamp ms=300", status, disconnected, "", reopened},
    // Drives.
    {tcp, "alarm motion=1 delay_ms=100 code=48", move, refused, "overload", cleared},
    {tcp, "limit motion=1 delay_ms=100", move, refused, "limit switch", cleared},
    {tcp, "watchdog motion=1 delay_ms=100", move, refused, "communication watchdog", cleared},
    {tcp, "jam motion=1 delay_ms=100", move, timed_out, "from the target", well},
    {tcp, "slip motion=1 delay_ms=100 degrees=2", move, timed_out, "from the target", well},
    {tcp, "door motion=1 delay_ms=100 ms=0", move, refused, "door", closed},
    {tcp, "e_stop motion=1 delay_ms=100 ms=0", move, refused, "emergency stop", closed},
    {tcp, "reboot motion=1 delay_ms=100 ms=300", move, timed_out, "", rehomed},
    {rtu, "alarm motion=1 delay_ms=100 code=32", move, refused, "position deviation", cleared},
    {rtu, "limit motion=1 delay_ms=100", move, refused, "limit switch", cleared},
    {rtu, "jam motion=1 delay_ms=100", move, timed_out, "from the target", well},
    {rtu, "slip motion=1 delay_ms=100 degrees=2", move, timed_out, "from the target", well},
    {rtu, "watchdog motion=1 delay_ms=100", move, refused, "communication watchdog", cleared},
    {rtu, "silence unit=2", status, timed_out, "unit 2", well},
    {rtu, "door motion=1 delay_ms=100 ms=0", move, refused, "door", closed},
    {rtu, "e_stop motion=1 delay_ms=100 ms=0", move, refused, "emergency stop", closed},
    {rtu, "reboot motion=1 delay_ms=100 ms=300", move, timed_out, "", rehomed},
    {grbl, "alarm motion=1 delay_ms=100 code=1", move, refused, "ALARM:1", cleared},
    {grbl, "alarm motion=1 delay_ms=100 code=2", move, refused, "ALARM:2", cleared},
    {grbl, "limit motion=1 delay_ms=100", move, refused, "ALARM:1", cleared},
    {grbl, "jam motion=1 delay_ms=100", move, timed_out, "from the target", well},
    {grbl, "slip motion=1 delay_ms=100 degrees=2", move, timed_out, "from the target", well},
    {grbl, "door motion=1 delay_ms=100 ms=0", move, refused, "door", closed},
    {grbl, "reboot motion=1 delay_ms=100 ms=300", move, disconnected, "restarted", rehomed},
    {grbl, "e_stop motion=1 delay_ms=100 ms=0", move, refused, "", closed},
    // The controller tells of its output, not of the light.
    {grbl, "lamp_failure lit=1", lamp_on, std::nullopt, "", well},
    {usb, "limit motion=1 delay_ms=100", move, refused, "ALARM:1", cleared},
    {usb, "door motion=1 delay_ms=100 ms=0", move, refused, "door", closed},
    {usb, "reboot motion=1 delay_ms=100 ms=300", move, disconnected, "restarted", rehomed},
    {lamp, "reboot wire=lamp ms=300", status, disconnected, "restarted", well},
    {lamp, "lamp_failure lit=1", lamp_on, std::nullopt, "", well},
};

/// All cases of a wire, several at a time; one complaint a line.
std::vector<std::string> complaints_of(Wired wire) {
  Rig rig = test::quick_rig();
  // Home is near where the axes are parked, so that homing takes no time.
  for (Axis& axis : rig.gantry.model.axes)
    axis.home = axis.min + 0.3 * (axis.max - axis.min) + 0.02;
  std::atomic<std::size_t> next{0};
  std::mutex mutex;
  std::vector<std::string> complaints;
  std::vector<std::jthread> workers;
  const int hands = wire == usb ? 1 : 6;  // one USB device can be emulated at a time
  for (int worker = 0; worker < hands; ++worker)
    workers.emplace_back([&] {
      for (std::size_t n = next++; n < cases.size(); n = next++) {
        if (cases[n].wire != wire) continue;
        const std::string wrong = FaultStory(cases[n], n, rig).run();
        if (wrong.empty()) continue;
        const std::lock_guard lock(mutex);
        complaints.push_back(fmt::format("{} while {}: {}", cases[n].fault,
                                         cases[n].doing == move     ? "moving"
                                         : cases[n].doing == status ? "asking"
                                                                    : "lighting",
                                         wrong));
      }
    });
  workers.clear();
  return complaints;
}

class WireFault : public testing::TestWithParam<Wired> {};

TEST_P(WireFault, IsSaidLeavesTheDrivesAtRestAndIsOverWhenItIsOver) {
  const bool modbus = GetParam() == tcp || GetParam() == rtu;
  if (!backends()[modbus ? 0 : 1].built) GTEST_SKIP() << "this backend is left out of this build";
  if (GetParam() == usb && !test::in_umockdevs_bed()) return test::pass_in_umockdevs_bed();
  static_cast<void>(test::enter_own_network());
  EXPECT_THAT(complaints_of(GetParam()), testing::IsEmpty());
}

INSTANTIATE_TEST_SUITE_P(Each, WireFault, testing::Values(tcp, rtu, grbl, usb, lamp),
                         [](const auto& wire) { return wire_name(wire.param); });

}  // namespace
}  // namespace lightrig
