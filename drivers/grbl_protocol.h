#pragma once

#include <cstddef>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace lightrig::grbl {

/// The words of GRBL 1.1 and grblHAL [Grbl v1.1 Interface], without any wire.

/// Where a letter's axis stands in a position: X, Y, Z, A, B, C.
inline std::size_t machine_axis(char letter) { return std::string_view("XYZABC").find(letter); }

/// A real-time status report, <State|MPos:…|…>.
struct StatusReport {
  std::string state;  ///< "Idle", "Run", "Hold", "Jog", "Alarm", "Door", "Home", "Check", "Sleep"
  int substate = -1;  ///< after the colon of Hold:0, Door:1, …; −1 without
  std::optional<std::vector<double>>
      machine_position;  ///< [mm or °], X, Y, Z, …; from MPos, or WPos + WCO
  std::optional<std::vector<double>> work_position;  ///< WPos, where that is what is reported
  std::optional<std::vector<double>> work_offset;    ///< WCO, now and then
  std::optional<double> spindle;                     ///< second number of FS
  std::string pins;                                  ///< letters of Pn, e.g. "XD"
};
/// Empty for a damaged report: a number that is none, not finite, or beyond its type.
std::optional<StatusReport> parse_status(std::string_view line);

/// Of an error:N or ALARM:N whose N came damaged; what it reports has happened all the same.
constexpr int unreadable_number = -1;

/// One line from the controller, by kind.
struct Line {
  enum class Kind { ok, error, alarm, status, banner, setting, message, other } kind = Kind::other;
  int number = 0;    ///< of error:N, ALARM:N (else unreadable_number), $N=
  double value = 0;  ///< of a setting
  std::string text;  ///< the line
};
Line parse_line(std::string_view line);

/// What error:N and ALARM:N mean, and what to do; "" for an unknown number.
std::string error_text(int number);
std::string alarm_text(int number);

/// Splits a byte stream into lines; CR, LF and CRLF each end one, empty ones are dropped.
class LineAssembler {
 public:
  void add(std::string_view bytes);
  std::optional<std::string> next();
  void clear() { pending_.clear(); }

 private:
  std::string pending_;
};

}  // namespace lightrig::grbl
