#pragma once

#include <cstdint>
#include <optional>
#include <stop_token>
#include <string>
#include <vector>

#include "config/rig.h"
#include "daemon/session/lay_candidates.h"
#include "daemon/session/pause_rules.h"
#include "daemon/session/session.h"
#include "drivers/devices.h"

namespace lightrig {

/// The session's hand on the devices: each verb is one attempt with its deadline and its checks; no
/// verb retries. Used by one thread.
class DeviceHand {
 public:
  DeviceHand(const Rig& rig, const Prepared& prepared, Devices& devices, Clock& clock,
             std::stop_token stop);

  Result<void> home();
  Result<GantryStatus> status();

  /// Drives there clear of every obstacle, lets the arm settle and sees that it stays.
  Result<void> go_to(const GantryPosition& target);

  /// That the gantry is there: homed, at rest, within tolerance, no alarm, no interlock open.
  /// Errors: refused, saying which of these is not so.
  Result<void> verify_at(const GantryPosition& target);

  /// Waits until the gantry is at rest, for a bounded time. Errors: timed_out.
  Result<GantryStatus> wait_for_rest();

  /// A frame of the right size, at the right exposure, not seen before; with the lamp on its lease
  /// is renewed first. Errors: timed_out for a frame that is not as asked, and the camera's.
  Result<Frame> expose(double seconds);

  Result<void> lamp_on();  ///< at the rig's power, warmed up
  /// That the lamp still burns as it was told, where it can be asked. Errors: timed_out.
  Result<void> still_lit() { return see_lamp(rig_.lamp.power); }
  /// Dark, whether or not a stop was asked for; several attempts. Errors: the last attempt's.
  Result<void> lamp_dark();
  bool lamp_known_dark() const { return lamp_ == LampKnown::dark; }
  bool lamp_known_on() const { return lamp_ == LampKnown::on; }
  /// The gantry's status as it was read last; empty before that, and after its wire was opened
  /// anew.
  const std::optional<GantryStatus>& last_status() const { return last_status_; }

  /// What the lamp says of itself, its temperature among it.
  Result<LampState> lamp_state();
  std::optional<double> camera_temperature() const;  ///< [°C] as of the last frame
  PacketWindow& packets() { return packets_; }

  /// Opens again what is lost (Reopen), destroyed before, lamp first; the lamp is told to go dark.
  /// A stop leaves the opening behind, unless it is opened to make the lamp dark.
  Result<void> reopen(const ReopenDevices& reopen, bool though_stopped = false);

  Result<void> sleep(double seconds);
  bool stop_requested() const { return stop_.stop_requested(); }

 private:
  enum class LampKnown : std::uint8_t { unknown, dark, on };

  Until within(double seconds) const;
  Result<void> renew_lamp(double seconds);
  Result<void> see_lamp(double power);
  Reopen what_is_lost();
  Result<void> check_frame(const Frame& frame, double seconds);

  const Rig& rig_;
  const std::vector<Candidate>& candidates_;
  const Obstacles obstacles_;
  Devices& devices_;
  Clock& clock_;
  std::stop_token stop_;
  LampKnown lamp_ = LampKnown::unknown;
  TimePoint lamp_renewed_{};
  std::optional<std::uint64_t> last_frame_id_;
  std::optional<GantryStatus> last_status_;
  PacketWindow packets_;
};

/// What keeps the gantry from being trusted to stand at `target`; "" when nothing does.
std::string not_in_place(const GantryModel& gantry, const GantryStatus& status,
                         const GantryPosition& target);

}  // namespace lightrig
