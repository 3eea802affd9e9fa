#pragma once

#include <map>
#include <optional>
#include <string>
#include <variant>
#include <vector>

#include "drivers/devices.h"
#include "drivers/grbl_protocol.h"
#include "drivers/usb/cdc_acm.h"
#include "drivers/usb/serial_port.h"

namespace lightrig {

/// A conversation with a GRBL controller: one command at a time, every wait ends by answer,
/// deadline or stop. Reads in steps of 5 ms, so a stop request is seen at once.
class GrblLink {
 public:
  /// Opens the wire, holds what still moves, and resets the controller, so that nothing queued by
  /// an earlier program can move; waits for its banner. A report of fewer than `axes` positions is
  /// damaged.
  static Result<GrblLink> open(const GrblEndpoint& endpoint, std::size_t axes, Clock& clock,
                               const Until& until);

  /// Sends a line and waits for its ok. An error is acknowledged where the firmware wants that
  /// (grblHAL). Errors: refused (error:N, ALARM:N with their meaning),
  /// timed_out, stopped, disconnected.
  Result<void> command(const std::string& line, const Until& until);
  /// Homes; its ok comes when it has ended. Meanwhile the controller is asked now and then whether
  /// it does home: a command that was lost would else be waited for in vain.
  Result<void> home(const Until& until);
  /// A real-time byte: never acknowledged, never queued.
  Result<void> realtime(char byte);
  /// Asks for a status report and waits for it, asking again where none comes; the machine position
  /// is always filled in, for every axis that the rig file names. A report with fewer numbers is
  /// damaged, and no report.
  Result<grbl::StatusReport> status(const Until& until);
  /// Soft reset; every pending ok is void. Waits for the banner.
  Result<void> reset(const Until& until);
  /// The status once the controller heeds lines again: held by `!` or by a door it obeys none until
  /// it is reset, which is done once it rests, where a reset keeps the position. A door still open
  /// holds it again at once; then the state says so.
  Result<grbl::StatusReport> release(const Until& until);
  /// The controller's $ settings, as two readings in a row have them: a line of one may be lost or
  /// damaged on the way, and nothing in it would tell.
  Result<std::map<int, double>> settings(const Until& until);

  /// ALARM:N seen and not forgotten since; 0 for none. A reset unlocks the wire, it mends nothing.
  int alarm() const { return alarm_; }
  void forget_alarm() { alarm_ = 0; }
  /// Halted by a hard or soft limit: it neither obeys nor answers anything but a reset.
  bool mute() const { return mute_; }

 private:
  using Wire = std::variant<CdcAcm, SerialPort>;
  GrblLink(Wire wire, std::size_t axes, Clock& clock)
      : wire_(std::move(wire)), axes_(axes), clock_(&clock) {}
  Result<std::optional<grbl::Line>> next_line(const Until& until);
  Result<void> forget_what_came(std::chrono::milliseconds quiet, const Until& until);
  Result<void> hold_what_moves(const Until& until);
  Result<void> send(std::string_view bytes);
  Result<void> begin(const std::string& line, const Until& until);
  void acknowledge_error(const Until& until);
  Result<std::map<int, double>> read_settings(const Until& until);
  std::optional<Result<void>> answer_in(const grbl::Line& line, const std::string& text);
  tl::unexpected<Error> halted() const;
  void heed_alarm(int number);

  Wire wire_;
  std::size_t axes_;  ///< numbers that a position must have
  Clock* clock_;
  grbl::LineAssembler lines_;
  std::vector<double> work_offset_;  ///< empty until two reports have told the same
  std::vector<double> said_offset_;  ///< by the last report that told one
  int alarm_ = 0;
  bool mute_ = false;
  bool hal_ = false;          ///< grblHAL, by its banner
  bool report_owed_ = false;  ///< a status report was asked for and never came
  bool in_step_ =
      true;  ///< false while an answer is owed: GRBL's answers carry no number to tell them apart
};

}  // namespace lightrig
