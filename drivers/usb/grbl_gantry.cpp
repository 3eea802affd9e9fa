#include "drivers/usb/grbl_gantry.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "drivers/lamp_power.h"
#include "drivers/progress_watch.h"

namespace lightrig {
namespace {

using namespace std::chrono_literals;

constexpr char feed_hold = '!';
constexpr std::chrono::milliseconds poll_interval{20};
constexpr std::chrono::milliseconds farewell{500};
constexpr std::chrono::milliseconds banner_patience{
    500};  // after a reset; it comes within some ten
constexpr std::chrono::milliseconds queueing_patience{2000};
/// For which nothing may come nearer to a move's target.
constexpr std::chrono::milliseconds stall_patience{2500};
/// A position beside a move's way counts from the second report: one may be damaged.
constexpr int reports_that_agree = 2;
constexpr double way_slack = 0.002;  // of an axis' travel
constexpr double unknown_position = std::numeric_limits<double>::quiet_NaN();
/// Polls that may say Idle away from the target before the move counts as failed: the planner
/// starts a move within one.
constexpr int idle_polls_before_start = 5;

/// Letters of a status report's Pn field, by the input names that a rig file's interlocks use.
char pin_of(const std::string& input) {
  if (input == "door") return 'D';
  if (input == "probe") return 'P';
  if (input == "hold") return 'H';
  if (input == "reset") return 'R';
  if (input == "start") return 'S';
  return '?';
}

}  // namespace

GrblGantryDevice::GrblGantryDevice(const Rig& rig, const GrblGantry& backend, Clock& clock,
                                   std::shared_ptr<GrblController> controller)
    : model_(rig.gantry.model),
      backend_(backend),
      interlocks_(rig.interlocks),
      clock_(clock),
      controller_(std::move(controller)),
      zero_(AxisValues::Zero(static_cast<Eigen::Index>(rig.gantry.model.axes.size()))) {}

GrblGantryDevice::~GrblGantryDevice() { tell_to_stop(); }

void GrblGantryDevice::tell_to_stop() {
  // A failure here cannot be helped: the wire is gone, and the controller decelerates on its own
  // limits only.
  (void)controller_->link.realtime(feed_hold);
  stop_pending_ = true;
}

GantryPosition GrblGantryDevice::position_of(const grbl::StatusReport& report) const {
  GantryPosition position{zero_};
  for (std::size_t i = 0; i < backend_.letters.size(); ++i) {
    const std::size_t axis = grbl::machine_axis(backend_.letters[i]);  // the link has seen to it
    const auto row = static_cast<Eigen::Index>(i);
    position.axes[row] += report.machine_position->at(axis) / backend_.units_per_si[i];
  }
  return position;
}

// After a feed hold the queue still holds the rest of the move, which a resume would drive; nor
// does a controller that is held heed any line. Once the axes rest, a reset empties the queue; at
// rest the controller keeps its position.
Result<void> GrblGantryDevice::settle_stop(const Until& until) {
  auto report = controller_->link.release(until);
  if (!report) return tl::unexpected(report.error());
  while (stop_pending_) {
    const bool moving = report->state == "Run" || report->state == "Jog" || report->state == "Home";
    if (!moving) {
      if (auto reset = controller_->link.reset(until); !reset) return reset;
      stop_pending_ = false;
      return {};
    }
    clock_.sleep_until(clock_.now() + poll_interval, until.stop);
    report = controller_->link.release(until);
    if (!report) return tl::unexpected(report.error());
  }
  return {};
}

Result<GantryStatus> GrblGantryDevice::status(const Until& until) {
  GantryStatus status;
  auto report = controller_->link.status(until);
  if (!report && controller_->link.mute()) {
    // It halted at once, and tells no position until it is reset.
    homed_ = false;
    status.alarm = report.error().message;
    status.at_rest = true;
    status.position.axes = AxisValues::Constant(zero_.size(), unknown_position);
    return status;
  }
  if (!report) {
    if (report.error().code == ErrorCode::disconnected) homed_ = false;
    return tl::unexpected(report.error());
  }
  status.position = position_of(*report);
  if (report->state == "Alarm") {
    homed_ = false;
    const int number = controller_->link.alarm();
    const std::string meaning = grbl::alarm_text(number);
    // Locked without an alarm is how it starts: not homed, and no more than that.
    if (number != 0) status.alarm = fmt::format("ALARM:{} {}", number, meaning);
  }
  status.homed = homed_;
  status.at_rest = report->state == "Idle" || report->state == "Alarm" ||
                   (report->state == "Hold" && report->substate == 0) ||
                   (report->state == "Door" && report->substate < 2);
  for (const Interlock& interlock : interlocks_)
    if (report->pins.find(pin_of(interlock.input)) != std::string::npos)
      status.open_interlocks.push_back(interlock.name);
  // Door:0 is a door that was closed again; what the controller calls so has no pin of ours.
  if (report->state == "Door" && report->substate != 0 && status.open_interlocks.empty())
    status.open_interlocks.emplace_back("door");
  return status;
}

Result<void> GrblGantryDevice::home(const Until& until) {
  homed_ = false;
  if (auto settled = settle_stop(until); !settled) return settled;
  if (auto done = controller_->link.home(until); !done) {
    // Homing heeds no feed hold: only a reset ends it. Its banner is read here: whatever comes
    // next, a lamp's 0 above all, would take it for a controller that restarted.
    if (done.error().code == ErrorCode::stopped || done.error().code == ErrorCode::timed_out)
      (void)controller_->link.reset({clock_.now() + banner_patience, {}});
    stop_pending_ = true;
    return tl::unexpected(with_context("home", done.error()));
  }
  for (const char* mode : {"G21", "G90", "G94"})
    if (auto set = controller_->link.command(mode, until); !set) return set;
  // Every later position hangs on this one, and GRBL's lines have no checksum: a digit damaged on
  // the way would move them all. Two reports must agree.
  auto report = controller_->link.status(until);
  if (!report) return tl::unexpected(with_context("home", report.error()));
  const auto again = controller_->link.status(until);
  if (!again) return tl::unexpected(with_context("home", again.error()));
  if (*report->machine_position != *again->machine_position)
    return fail(ErrorCode::timed_out,
                "home: two status reports at rest disagree; check the cable and its shield");
  controller_->link.forget_alarm();
  zero_.setZero();
  const GantryPosition machine = position_of(*report);
  for (Eigen::Index i = 0; i < zero_.size(); ++i)
    zero_[i] = model_.axes[static_cast<std::size_t>(i)].home - machine.axes[i];
  homed_ = true;
  return {};
}

// A straight G1 in machine coordinates at the feed that keeps every axis within the rig's own speed
// limit. G0 would run at the controller's speeds, which nobody here has checked.
std::string GrblGantryDevice::move_command(const GantryPosition& from,
                                           const GantryPosition& to) const {
  std::string words;
  double seconds = 0;
  double length_squared = 0;
  for (std::size_t i = 0; i < backend_.letters.size(); ++i) {
    const auto row = static_cast<Eigen::Index>(i);
    const double travel = to.axes[row] - from.axes[row];
    seconds = std::max(seconds, std::abs(travel) / model_.axes[i].max_speed);
    length_squared += std::pow(travel * backend_.units_per_si[i], 2);
    words += fmt::format(" {}{:.4f}", backend_.letters[i],
                         (to.axes[row] - zero_[row]) * backend_.units_per_si[i]);
  }
  const double feed = 60 * std::sqrt(length_squared) / std::max(seconds, 1e-6);  // [mm/min]
  return fmt::format("G53 G1{} F{:.3f}", words, std::max(feed, 0.001));
}

Result<void> GrblGantryDevice::move_to(const GantryPosition& position, const Until& until) {
  if (!within_limits(model_, position))
    return fail(ErrorCode::refused, "the target lies outside the gantry's travel; nothing moved");
  if (auto settled = settle_stop(until); !settled) return settled;
  auto before = status(until);
  if (!before)
    return tl::unexpected(with_context("read the position before the move", before.error()));
  if (!before->alarm.empty()) return fail(ErrorCode::refused, before->alarm);
  if (!before->homed) return fail(ErrorCode::refused, "not homed: home first");
  if (!before->open_interlocks.empty())
    return fail(ErrorCode::refused, "interlock open: " + before->open_interlocks.front());
  // At rest its ok comes at once; one that was lost is not waited for as long as the move may take.
  const Until soon{std::min(until.deadline, clock_.now() + queueing_patience), until.stop};
  Result<void> done = controller_->link.command(move_command(before->position, position), soon);
  if (done) done = wait_for_arrival(before->position, position, until);
  if (!done) {
    tell_to_stop();
    return tl::unexpected(with_context("move", done.error()));
  }
  return {};
}

// A straight way stays between its ends. Lines have no checksum: a digit that was lost may have
// made another target of ours, beyond what the rig allows.
bool GrblGantryDevice::leaves_way(const GantryPosition& from, const GantryPosition& to,
                                  const GantryPosition& here) const {
  for (std::size_t i = 0; i < model_.axes.size(); ++i) {
    const auto row = static_cast<Eigen::Index>(i);
    const Axis& axis = model_.axes[i];
    const auto [least, most] = std::minmax(from.axes[row], to.axes[row]);
    const double slack = 5 * (axis.rotary ? model_.tolerance : model_.linear_tolerance) +
                         way_slack * (axis.max - axis.min);
    if (here.axes[row] < least - slack || here.axes[row] > most + slack) return true;
  }
  return false;
}

// ok means queued, not done. Arrival is Idle within tolerance; Idle elsewhere is only believed
// after the planner had time to start.
Result<void> GrblGantryDevice::wait_for_arrival(const GantryPosition& from,
                                                const GantryPosition& target, const Until& until) {
  int idle_elsewhere = 0;
  int beside_way = 0;
  ProgressWatch progress(model_, from, target, clock_.now(), stall_patience);
  for (;;) {
    auto now = status(until);
    if (!now) return tl::unexpected(now.error());
    if (!now->alarm.empty()) return fail(ErrorCode::refused, now->alarm);
    if (!now->open_interlocks.empty())
      return fail(ErrorCode::refused, "interlock opened: " + now->open_interlocks.front());
    const double off = (now->position.axes - target.axes).cwiseAbs().maxCoeff();
    if (now->at_rest && arrived(model_, now->position, target)) return {};
    if (now->at_rest && ++idle_elsewhere >= idle_polls_before_start)
      return fail(
          ErrorCode::timed_out,
          fmt::format(
              "the controller rests {:.4g} (rad or m) from the target, tolerance {:.4g} rad "
              "or {:.4g} m",
              off, model_.tolerance, model_.linear_tolerance));
    if (!now->at_rest) idle_elsewhere = 0;
    beside_way = leaves_way(from, target, now->position) ? beside_way + 1 : 0;
    if (beside_way >= reports_that_agree)
      return fail(ErrorCode::timed_out,
                  fmt::format("it leaves the way to its target, {:.4g} (rad or m) from the target: "
                              "was the command damaged? check the cable and its shield",
                              off));
    // The wrong way is judged above, by more than one report.
    if (const auto nearer = progress.see(now->position, clock_.now());
        !nearer && nearer.error().code == ErrorCode::timed_out)
      return tl::unexpected(nearer.error());
    clock_.sleep_until(clock_.now() + poll_interval, until.stop);
  }
}

Result<void> GrblGantryDevice::clear_fault(const Until& until) {
  if (auto reset = controller_->link.reset(until); !reset) return reset;
  controller_->link.forget_alarm();
  stop_pending_ = false;
  auto report = controller_->link.status(until);
  if (!report) return tl::unexpected(report.error());
  if (report->state == "Alarm")
    homed_ = false;  // unlocking without homing ($X) would believe a lost position
  return {};
}

GrblLampDevice::~GrblLampDevice() {
  // Known dark: no reason for a reset, which would cost an arm that still brakes its position.
  if (power_ == 0) return;
  const Until until{clock_.now() + farewell, {}};
  if (!set(0, until)) (void)controller_->link.realtime(0x18);  // a reset switches every output off
}

std::string GrblLampDevice::command_for(double power) const {
  if (output_ == "mist" && power > 0) return "M7";
  if (output_ != "spindle") return power > 0 ? "M8" : "M9";
  const auto full = controller_->settings.find(30);
  const double scale = full == controller_->settings.end() ? 1000.0 : full->second;
  return power > 0 ? fmt::format("M3 S{:.1f}", power * scale) : std::string("M5");
}

// A controller that is held or locked takes no line, not even to switch off; a reset switches every
// output off. In motion it would lose the position, so it waits for rest; a hard or soft limit is
// halted already.
Result<void> GrblLampDevice::set(double power, const Until& until) {
  if (auto allowed = allowed_power(power, most_); !allowed) return allowed;
  if (controller_->link.mute() && power == 0) {
    if (auto reset = controller_->link.reset(until); !reset)
      return tl::unexpected(with_context("switch the lamp off by a reset", reset.error()));
  }
  const auto report = controller_->link.release(until);
  if (!report) return tl::unexpected(with_context("switch the lamp", report.error()));
  if (report->state == "Door" && power == 0) {  // still open: the reset has switched it off
    power_ = 0;
    return {};
  }
  if (report->state == "Door" || report->state == "Alarm")
    if (power > 0)
      return fail(ErrorCode::refused, fmt::format("switch the lamp: the controller's state is {}, "
                                                  "in which it switches nothing on",
                                                  report->state));
  const std::string command = command_for(power);
  const double before = power_;
  if (power > 0) power_ = power;  // lit perhaps, whatever comes of the answer
  auto done = controller_->link.command(command, until);
  if (!done && done.error().code == ErrorCode::refused) power_ = before;
  // Locked (before homing, after an alarm) the controller takes no G-code, not even to switch off;
  // a reset switches every output off, and locked axes are at rest.
  if (!done && power == 0 && done.error().code == ErrorCode::refused)
    done = controller_->link.reset(until);
  if (done) done = check_spindle(power, until);
  if (!done) return tl::unexpected(with_context("switch the lamp", done.error()));
  power_ = power;
  return {};
}

// A digit that was lost on the way makes another power of it. Reports have whole numbers only.
Result<void> GrblLampDevice::check_spindle(double power, const Until& until) {
  const auto full = controller_->settings.find(30);
  if (output_ != "spindle" || full == controller_->settings.end()) return {};
  const auto report = controller_->link.status(until);
  if (!report) return tl::unexpected(report.error());
  const double wanted = power * full->second;
  if (!report->spindle || std::abs(*report->spindle - wanted) <= 1 + 0.005 * wanted) return {};
  return fail(
      ErrorCode::timed_out,
      fmt::format("asked for S{:.1f}, but the controller says S{}: check $31, and the cable "
                  "and its shield",
                  wanted, *report->spindle));
}

Result<LampState> GrblLampDevice::state(const Until& until) {
  LampState state{power_, false, std::nullopt};
  if (output_ != "spindle") return state;
  auto report = controller_->link.status(until);
  if (!report) return tl::unexpected(with_context("read the lamp", report.error()));
  const auto full = controller_->settings.find(30);
  if (report->spindle && full != controller_->settings.end() && full->second > 0) {
    state.power = *report->spindle / full->second;
    state.confirmed = true;
  }
  return state;
}

}  // namespace lightrig
