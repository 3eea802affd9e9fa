#include "drivers/grbl_protocol.h"

#include <algorithm>
#include <charconv>
#include <cmath>

namespace lightrig::grbl {
namespace {

std::vector<std::string_view> split(std::string_view text, char separator) {
  std::vector<std::string_view> parts;
  for (std::size_t begin = 0; begin <= text.size();) {
    const std::size_t end = std::min(text.find(separator, begin), text.size());
    parts.push_back(text.substr(begin, end - begin));
    begin = end + 1;
  }
  return parts;
}

// GRBL writes plain decimals; "nan", "inf" and exponents are damage, whatever they parse to.
std::optional<double> number(std::string_view text) {
  double value = 0;
  const auto [end, error] =
      std::from_chars(text.data(), text.data() + text.size(), value, std::chars_format::fixed);
  if (error != std::errc() || end != text.data() + text.size() || !std::isfinite(value))
    return std::nullopt;
  return value;
}

std::optional<int> whole_number(std::string_view text) {
  int value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc() || end != text.data() + text.size()) return std::nullopt;
  return value;
}

std::optional<std::vector<double>> numbers(std::string_view text) {
  std::vector<double> values;
  for (std::string_view part : split(text, ',')) {
    const auto value = number(part);
    if (!value) return std::nullopt;
    values.push_back(*value);
  }
  return values;
}

}  // namespace

std::optional<StatusReport> parse_status(std::string_view line) {
  if (line.size() < 3 || line.front() != '<' || line.back() != '>') return std::nullopt;
  const auto fields = split(line.substr(1, line.size() - 2), '|');
  StatusReport report;
  const auto state = split(fields[0], ':');
  report.state = std::string(state[0]);
  if (state.size() > 1) {
    const auto substate = whole_number(state[1]);
    if (!substate) return std::nullopt;  // it tells rest from motion
    report.substate = *substate;
  }
  for (std::size_t i = 1; i < fields.size(); ++i) {
    const std::size_t colon = fields[i].find(':');
    if (colon == std::string_view::npos) return std::nullopt;
    const std::string_view key = fields[i].substr(0, colon);
    const std::string_view value = fields[i].substr(colon + 1);
    if (key == "MPos" || key == "WPos" || key == "WCO" || key == "FS") {
      auto parsed = numbers(value);
      if (!parsed) return std::nullopt;  // a damaged report is no report
      if (key == "MPos") report.machine_position = std::move(parsed);
      if (key == "WPos") report.work_position = std::move(parsed);
      if (key == "WCO") report.work_offset = std::move(parsed);
      if (key == "FS" && parsed && parsed->size() > 1) report.spindle = (*parsed)[1];
    } else if (key == "Pn") {
      report.pins = std::string(value);
    }
  }
  return report;
}

Line parse_line(std::string_view line) {
  Line parsed;
  parsed.text = std::string(line);
  if (line == "ok") {
    parsed.kind = Line::Kind::ok;
  } else if (line.starts_with("error:")) {
    parsed.kind = Line::Kind::error;
    parsed.number = whole_number(line.substr(6)).value_or(unreadable_number);
  } else if (line.starts_with("ALARM:")) {
    parsed.kind = Line::Kind::alarm;
    parsed.number = whole_number(line.substr(6)).value_or(unreadable_number);
  } else if (line.starts_with('<')) {
    parsed.kind = Line::Kind::status;
  } else if (line.starts_with("Grbl ") || line.starts_with("GrblHAL ")) {
    parsed.kind = Line::Kind::banner;
  } else if (line.starts_with('$') && line.find('=') != std::string_view::npos) {
    const std::size_t equals = line.find('=');
    const auto key = whole_number(line.substr(1, equals - 1));
    const auto value = number(line.substr(equals + 1));
    if (key && value) {
      parsed.kind = Line::Kind::setting;
      parsed.number = *key;
      parsed.value = *value;
    }
  } else if (line.starts_with('[')) {
    parsed.kind = Line::Kind::message;
  }
  return parsed;
}

std::string error_text(int number) {
  switch (number) {
    case 5:
      return "homing is not enabled in the controller: set $22=1";
    case 8:
      return "the command needs the controller to be idle";
    case 9:
      return "G-code is locked out in alarm or jog state: home first";
    case 13:
      return "the safety door is open";
    case 15:
      return "the jog target lies beyond the controller's travel";
    case 20:
      return "the controller does not know this G-code";
    case 22:
      return "no feed rate given";
    default:
      return {};
  }
}

std::string alarm_text(int number) {
  switch (number) {
    case 1:
      return "hard limit: a limit switch was hit, the position is lost; free the axis and home";
    case 2:
      return "soft limit: the target lies beyond the controller's travel";
    case 3:
      return "reset in motion: the position is lost; home again";
    case 6:
      return "homing failed: it was reset";
    case 7:
      return "homing failed: the door was opened";
    case 8:
      return "homing failed: the limit switch did not clear; raise the pull-off $27 or check "
             "wiring";
    case 9:
      return "homing failed: no limit switch found within the travel; check wiring and $130…";
    default:
      return {};
  }
}

void LineAssembler::add(std::string_view bytes) { pending_ += bytes; }

std::optional<std::string> LineAssembler::next() {
  for (;;) {
    const std::size_t end = pending_.find_first_of("\r\n");
    if (end == std::string::npos) {
      // A line that never ends is noise; the longest of GRBL's is far below this.
      if (pending_.size() > 4096) pending_.clear();
      return std::nullopt;
    }
    std::string line = pending_.substr(0, end);
    pending_.erase(0, end + 1);
    if (!line.empty()) return line;
  }
}

}  // namespace lightrig::grbl
