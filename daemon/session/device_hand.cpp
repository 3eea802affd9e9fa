#include "daemon/session/device_hand.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "daemon/session/guarded_move.h"
#include "daemon/session/lay_candidates.h"

namespace lightrig {
namespace {

constexpr double answer_time = 2.0;    ///< [s] for a question that moves nothing
constexpr double camera_margin = 5.0;  ///< [s] beyond exposure and readout
constexpr double rest_time = 10.0;     ///< [s] within which a stopped gantry comes to rest
constexpr double rest_poll = 0.02;     ///< [s]
constexpr int settle_attempts = 5;     ///< an arm that still swings gets as many settle times
constexpr int dark_attempts = 3;

TimePoint later(TimePoint time, double seconds) {
  return time + std::chrono::duration_cast<std::chrono::nanoseconds>(
                    std::chrono::duration<double>(seconds));
}

std::string axis_text(const Axis& axis, double value) { return value_text(axis, value, 4); }

tl::unexpected<Error> not_open(const char* device) {
  return fail(ErrorCode::disconnected,
              fmt::format("the {} is not open: opening the devices again failed before", device));
}

tl::unexpected<Error> stopped() { return fail(ErrorCode::stopped, "stopped on request"); }

}  // namespace

std::string not_in_place(const GantryModel& gantry, const GantryStatus& status,
                         const GantryPosition& target) {
  if (!status.alarm.empty()) return "the gantry reports alarm " + status.alarm;
  if (!status.open_interlocks.empty()) {
    return fmt::format("interlock open: {}", fmt::join(status.open_interlocks, ", "));
  }
  if (!status.homed) return "the gantry has lost its home position";
  if (!status.at_rest) return "the gantry is moving";
  if (status.position.axes.size() != target.axes.size()) return "the gantry reports other axes";
  for (std::size_t i = 0; i < gantry.axes.size(); ++i) {
    const auto axis = static_cast<Eigen::Index>(i);
    const double off = std::abs(status.position.axes[axis] - target.axes[axis]);
    // Written so that a position that is not a number is out of place.
    if (!(off <= tolerance_of(gantry, i))) {
      return fmt::format("axis {} stands at {}, {} from {} (tolerance {})", gantry.axes[i].name,
                         axis_text(gantry.axes[i], status.position.axes[axis]),
                         axis_text(gantry.axes[i], off),
                         axis_text(gantry.axes[i], target.axes[axis]),
                         axis_text(gantry.axes[i], tolerance_of(gantry, i)));
    }
  }
  return {};
}

DeviceHand::DeviceHand(const Rig& rig, const Prepared& prepared, Devices& devices, Clock& clock,
                       std::stop_token stop)
    : rig_(rig),
      candidates_(prepared.candidates),
      obstacles_(obstacles_of(rig, &prepared.object.mesh)),
      devices_(devices),
      clock_(clock),
      stop_(std::move(stop)),
      packets_(rig.pause.packet_loss ? rig.pause.packet_loss->over_frames : 1) {
  if (devices.camera) packets_.begin(devices.camera->counters());
}

Until DeviceHand::within(double seconds) const { return {later(clock_.now(), seconds), stop_}; }

Result<void> DeviceHand::home() {
  if (!devices_.gantry) return not_open("gantry");
  const double seconds = std::chrono::duration<double>(rig_.gantry.homing_timeout).count();
  auto homed = devices_.gantry->home(within(seconds));
  if (!homed) return tl::unexpected(with_context("home the gantry", homed.error()));
  const auto now = wait_for_rest();
  if (!now) return tl::unexpected(now.error());
  if (!now->homed) {
    return fail(ErrorCode::refused,
                "home the gantry: it reports success, but not that it is homed; check the home "
                "switches and the controller");
  }
  return {};
}

Result<GantryStatus> DeviceHand::status() {
  if (!devices_.gantry) return not_open("gantry");
  auto status = devices_.gantry->status(within(answer_time));
  if (!status) return tl::unexpected(with_context("ask the gantry's status", status.error()));
  last_status_ = *status;
  return status;
}

Result<GantryStatus> DeviceHand::wait_for_rest() {
  const TimePoint deadline = later(clock_.now(), rest_time);
  while (true) {
    auto now = status();
    if (!now || now->at_rest) return now;
    if (clock_.now() >= deadline) {
      return fail(ErrorCode::timed_out,
                  fmt::format("wait for the gantry to come to rest: still moving after {} s; stop "
                              "it by hand and check the controller",
                              rest_time));
    }
    if (auto slept = sleep(rest_poll); !slept) return tl::unexpected(slept.error());
  }
}

Result<void> DeviceHand::go_to(const GantryPosition& target) {
  const auto now = status();
  if (!now) return tl::unexpected(now.error());
  if (!now->homed || !now->alarm.empty() || !now->open_interlocks.empty() || !now->at_rest) {
    return fail(ErrorCode::refused,
                "move the gantry: " + not_in_place(rig_.gantry.model, *now, target));
  }
  const auto way = clear_way(rig_, obstacles_, candidates_, now->position, target);
  if (!way) return tl::unexpected(with_context("move the gantry", way.error()));
  for (auto from = now; const GantryPosition& stop : *way) {
    if (&stop != &way->front()) from = status();
    if (!from) return tl::unexpected(from.error());
    auto moved = guarded_move(rig_, obstacles_, *devices_.gantry, *from, stop, clock_, stop_);
    if (!moved) return tl::unexpected(with_context("move the gantry", moved.error()));
  }
  // Arrived means in place for the whole settle time, not at one lucky moment.
  std::string reason;
  for (int attempt = 0; attempt < settle_attempts; ++attempt) {
    if (auto slept = sleep(rig_.gantry.model.settle_time); !slept) return slept;
    const auto settled = status();
    if (!settled) return tl::unexpected(settled.error());
    reason = not_in_place(rig_.gantry.model, *settled, target);
    if (reason.empty()) return {};
    if (!settled->homed || !settled->alarm.empty() || !settled->open_interlocks.empty()) {
      return fail(ErrorCode::refused, "settle after the move: " + reason);
    }
  }
  return fail(ErrorCode::timed_out,
              fmt::format("settle after the move: {} after {} settle times of {} s; raise "
                          "[gantry] settle time or tolerance, or have the axis looked at",
                          reason, settle_attempts, rig_.gantry.model.settle_time));
}

Result<void> DeviceHand::verify_at(const GantryPosition& target) {
  const auto now = status();
  if (!now) return tl::unexpected(now.error());
  const std::string reason = not_in_place(rig_.gantry.model, *now, target);
  if (!reason.empty()) return fail(ErrorCode::refused, "verify the position: " + reason);
  return {};
}

Result<void> DeviceHand::check_frame(const Frame& frame, double seconds) {
  const CameraModel& camera = rig_.camera.model;
  const auto sites =
      static_cast<std::size_t>(camera.width) * static_cast<std::size_t>(camera.height);
  std::string wrong;
  // One part in a hundred, or ten microseconds: what cameras round exposures to.
  const double allowed = std::max(0.01 * seconds, 1e-5);
  if (frame.counts.width != camera.width || frame.counts.height != camera.height ||
      frame.counts.counts.size() != sites) {
    wrong = fmt::format("it is {} × {}, not {} × {}", frame.counts.width, frame.counts.height,
                        camera.width, camera.height);
  } else if (!(std::abs(frame.exposure - seconds) <= allowed)) {
    wrong = fmt::format("it was exposed for {} s, not {} s", frame.exposure, seconds);
  } else if (last_frame_id_ == frame.id) {
    wrong = fmt::format("it is frame {} again", frame.id);
  }
  if (wrong.empty()) return {};
  return fail(ErrorCode::timed_out, "take a frame: the camera gave one that was not asked for (" +
                                        wrong + "); it was thrown away");
}

Result<Frame> DeviceHand::expose(double seconds) {
  if (!devices_.camera) return not_open("camera");
  if (lamp_ == LampKnown::on) {
    if (auto renewed = renew_lamp(seconds); !renewed) return tl::unexpected(renewed.error());
  }
  auto frame =
      devices_.camera->expose(seconds, within(seconds + rig_.camera.readout_time + camera_margin));
  packets_.add(devices_.camera->counters());
  if (!frame) {
    return tl::unexpected(
        with_context(fmt::format("take a frame of {} s", seconds), frame.error()));
  }
  if (auto checked = check_frame(*frame, seconds); !checked) return tl::unexpected(checked.error());
  last_frame_id_ = frame->id;
  return frame;
}

Result<void> DeviceHand::renew_lamp(double seconds) {
  const double lease = std::chrono::duration<double>(rig_.lamp.max_on_time).count();
  const double held = std::chrono::duration<double>(clock_.now() - lamp_renewed_).count();
  if (held + seconds + rig_.camera.readout_time < 0.5 * lease) return {};
  auto set = devices_.lamp->set(rig_.lamp.power, within(answer_time));
  if (!set) return tl::unexpected(with_context("renew the lamp's lease", set.error()));
  lamp_renewed_ = clock_.now();
  return {};
}

Result<void> DeviceHand::lamp_on() {
  if (!devices_.lamp) return not_open("lamp");
  // Whatever becomes of this call, the lamp is no longer known to be dark.
  lamp_ = LampKnown::unknown;
  auto set = devices_.lamp->set(rig_.lamp.power, within(answer_time));
  if (!set) return tl::unexpected(with_context("switch the lamp on", set.error()));
  lamp_ = LampKnown::on;
  lamp_renewed_ = clock_.now();
  if (auto seen = see_lamp(rig_.lamp.power); !seen) return seen;
  return sleep(rig_.lamp.warm_up);
}

/// That a lamp which can be asked says it does as it was told.
Result<void> DeviceHand::see_lamp(double power) {
  const auto state = devices_.lamp->state({later(clock_.now(), answer_time), std::stop_token()});
  if (!state) return tl::unexpected(with_context("ask the lamp's state", state.error()));
  if (!state->confirmed || std::abs(state->power - power) <= 0.01) return {};
  return fail(ErrorCode::timed_out,
              fmt::format("switch the lamp: it was told {:.2f} and says it is at {:.2f}", power,
                          state->power));
}

Result<void> DeviceHand::lamp_dark() {
  // A destroyed lamp's lease has ended; but what cannot be asked is not known.
  if (!devices_.lamp) return lamp_known_dark() ? Result<void>{} : Result<void>(not_open("lamp"));
  Result<void> set;
  for (int attempt = 0; attempt < dark_attempts; ++attempt) {
    // Not our stop token: a stop is just when the lamp must go dark.
    set = devices_.lamp->set(0, {later(clock_.now(), answer_time), std::stop_token()});
    if (set) set = see_lamp(0);
    if (set) {
      lamp_ = LampKnown::dark;
      return {};
    }
    if (set.error().code == ErrorCode::disconnected) break;
  }
  // A lamp that went dark when told so stays dark, though its wire be gone now; unless it says it
  // does not.
  if (lamp_ == LampKnown::on || set.error().code == ErrorCode::timed_out)
    lamp_ = LampKnown::unknown;
  return tl::unexpected(with_context("switch the lamp off", set.error()));
}

Reopen DeviceHand::what_is_lost() {
  const auto soon = [this] { return Until{later(clock_.now(), answer_time), std::stop_token()}; };
  if (!devices_.gantry || !devices_.gantry->status(soon())) return Reopen::everything;
  if (devices_.lamp && devices_.lamp->state(soon())) return Reopen::camera;
  return lamp_has_own_wire(rig_) ? Reopen::lamp : Reopen::everything;
}

Result<void> DeviceHand::reopen(const ReopenDevices& reopen, bool though_stopped) {
  const Reopen what = what_is_lost();
  if (what != Reopen::camera) {
    if (lamp_ == LampKnown::on) lamp_ = LampKnown::unknown;
    devices_.lamp.reset();
  }
  if (what == Reopen::everything) {
    devices_.gantry.reset();
    last_status_.reset();
  }
  std::unique_ptr<Camera> old = what == Reopen::lamp ? nullptr : std::move(devices_.camera);
  auto opened = reopen(what, std::move(old), though_stopped ? std::stop_token() : stop_);
  if (!opened) return tl::unexpected(with_context("open the devices again", opened.error()));
  if (opened->camera) {
    last_frame_id_.reset();
    devices_.camera = std::move(opened->camera);
    packets_.begin(devices_.camera->counters());
  }
  if (opened->gantry) devices_.gantry = std::move(opened->gantry);
  if (opened->lamp) devices_.lamp = std::move(opened->lamp);
  return lamp_dark();
}

Result<LampState> DeviceHand::lamp_state() {
  if (!devices_.lamp) return not_open("lamp");
  auto state = devices_.lamp->state(within(answer_time));
  if (!state) return tl::unexpected(with_context("ask the lamp's state", state.error()));
  return state;
}

std::optional<double> DeviceHand::camera_temperature() const {
  if (!devices_.camera) return std::nullopt;
  return devices_.camera->counters().temperature_c;
}

Result<void> DeviceHand::sleep(double seconds) {
  if (seconds > 0) clock_.sleep_until(later(clock_.now(), seconds), stop_);
  if (stop_.stop_requested()) return stopped();
  return {};
}

}  // namespace lightrig
