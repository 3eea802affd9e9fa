#include "drivers/usb/grbl_link.h"

#include <fmt/format.h>

#include <algorithm>

namespace lightrig {
namespace {

using namespace std::chrono_literals;

constexpr char soft_reset = 0x18;
constexpr int hard_limit = 1, soft_limit = 2;  // of ALARM:N
constexpr std::chrono::milliseconds read_step{5};
constexpr std::chrono::milliseconds write_patience{250};
constexpr std::chrono::milliseconds rest_poll{10};
constexpr std::chrono::milliseconds braking_patience{5000};
constexpr std::chrono::milliseconds hold_patience{500};  // until a hold shows
constexpr int most_silences = 3;
constexpr std::chrono::milliseconds homing_look{1000};
/// A report comes within a few milliseconds; asked for again, a lost one costs no more than this.
constexpr std::chrono::milliseconds report_patience{200};
constexpr std::chrono::milliseconds acknowledge_patience{500};
/// A hundred lines at 9600 baud, and a controller that is busy with its EEPROM.
constexpr std::chrono::milliseconds settings_patience{3000};
constexpr int most_settings_readings = 5;
/// A report later than this after the question was given up is beyond what a link can repair.
constexpr std::chrono::milliseconds quiet_after_silence{100};

std::string with_meaning(const std::string& line, const std::string& meaning) {
  return meaning.empty() ? line : fmt::format("{} ({})", line, meaning);
}

}  // namespace

Result<GrblLink> GrblLink::open(const GrblEndpoint& endpoint, std::size_t axes, Clock& clock,
                                const Until& until) {
  auto wire = std::visit(
      [](const auto& at) -> Result<Wire> {
        if constexpr (std::is_same_v<std::decay_t<decltype(at)>, UsbEndpoint>) {
          auto port = CdcAcm::open(at);
          if (!port) return tl::unexpected(port.error());
          return Wire(std::move(*port));
        } else {
          auto port = SerialPort::open(at);
          if (!port) return tl::unexpected(port.error());
          return Wire(std::move(*port));
        }
      },
      endpoint);
  if (!wire) return tl::unexpected(wire.error());
  GrblLink link(std::move(*wire), axes, clock);
  if (auto held = link.hold_what_moves(until); !held)
    return tl::unexpected(with_context("look what the controller does", held.error()));
  link.forget_alarm();  // of a conversation that is over
  if (auto reset = link.reset(until); !reset)
    return tl::unexpected(with_context("wait for GRBL's banner after a reset", reset.error()));
  return link;
}

// A reset in motion loses steps, and the position with them: what an earlier program left moving,
// or braking from its stop, is held and waited for. A lamp that is lit comes first, and nothing but
// a reset darkens it in a hold: that resets at once. So does who answers nothing, or does not stop.
Result<void> GrblLink::hold_what_moves(const Until& until) {
  const TimePoint latest = std::min(until.deadline, clock_->now() + braking_patience);
  (void)forget_what_came({}, until);  // of a conversation that is over
  const TimePoint heeded_by = clock_->now() + hold_patience;
  for (int silent = 0; silent < most_silences && clock_->now() < latest;) {
    Until look = until;
    look.deadline = clock_->now() + report_patience;
    if (auto asked = realtime('?'); !asked) return asked;
    const auto line = next_line(look);
    if (!line) return tl::unexpected(line.error());
    if (!*line) {
      ++silent;
      continue;
    }
    if ((*line)->kind != grbl::Line::Kind::status) continue;
    const auto report = grbl::parse_status((*line)->text);
    if (!report) continue;  // damaged on the way: the next one tells
    const bool driven = report->state == "Run" || report->state == "Jog";
    const bool slowing = (report->state == "Hold" && report->substate > 0) ||
                         (report->state == "Door" && report->substate > 1);
    if ((!driven && !slowing) || report->spindle.value_or(0) > 0) return {};
    if (driven && clock_->now() >= heeded_by) return {};
    if (driven)  // again and again: one byte may be lost
      if (auto asked = realtime('!'); !asked) return asked;
    clock_->sleep_until(clock_->now() + rest_poll, until.stop);
  }
  return {};
}

Result<void> GrblLink::send(std::string_view bytes) {
  return std::visit([&](auto& wire) { return wire.write_all(bytes, write_patience); }, wire_);
}

Result<void> GrblLink::realtime(char byte) { return send(std::string_view(&byte, 1)); }

// One line, or nothing when the time ran out. Alarms are remembered wherever they turn up.
Result<std::optional<grbl::Line>> GrblLink::next_line(const Until& until) {
  for (;;) {
    if (auto text = lines_.next()) {
      grbl::Line line = grbl::parse_line(*text);
      if (line.kind == grbl::Line::Kind::alarm) heed_alarm(line.number);
      return std::optional(std::move(line));
    }
    if (until.stop.stop_requested()) return fail(ErrorCode::stopped, "stopped on request");
    if (clock_->now() >= until.deadline) return std::optional<grbl::Line>();
    auto bytes = std::visit([](auto& wire) { return wire.read_some(read_step); }, wire_);
    if (!bytes) return tl::unexpected(bytes.error());
    lines_.add(*bytes);
  }
}

// Reports and oks carry no number: what came unasked, late or twice is thrown away before the next
// question, so that it can never be taken for its answer. Alarms in it are remembered.
Result<void> GrblLink::forget_what_came(std::chrono::milliseconds quiet, const Until& until) {
  using std::chrono::steady_clock;
  bool restarted = false;
  auto quiet_until = steady_clock::now() + quiet;
  for (;;) {
    while (auto text = lines_.next()) {
      const grbl::Line line = grbl::parse_line(*text);
      if (line.kind == grbl::Line::Kind::alarm) heed_alarm(line.number);
      restarted = restarted || line.kind == grbl::Line::Kind::banner;
    }
    const auto patience = quiet.count() > 0 ? read_step : std::chrono::milliseconds(0);
    auto bytes = std::visit([&](auto& wire) { return wire.read_some(patience); }, wire_);
    if (!bytes) return tl::unexpected(bytes.error());
    lines_.add(*bytes);
    if (!bytes->empty()) quiet_until = steady_clock::now() + quiet;
    if (bytes->empty() && steady_clock::now() >= quiet_until) break;
    if (until.stop.stop_requested()) return fail(ErrorCode::stopped, "stopped on request");
    if (clock_->now() >= until.deadline)
      return fail(ErrorCode::timed_out,
                  "the controller does not stop talking: is another program's "
                  "automatic report on?");
  }
  lines_.clear();
  if (!restarted) return {};
  in_step_ = true;  // whatever was owed is void
  return fail(ErrorCode::disconnected, "the controller restarted");
}

/// Sends a line to a controller that owes no answer.
Result<void> GrblLink::begin(const std::string& text, const Until& until) {
  // An answer still owed would be taken for this command's: only a reset makes it void.
  if (!in_step_ && !mute())
    if (auto reset_done = reset(until); !reset_done) return reset_done;
  if (until.stop.stop_requested()) return fail(ErrorCode::stopped, "stopped on request");
  if (clock_->now() >= until.deadline)
    return fail(ErrorCode::timed_out, fmt::format("\"{}\": no time left to send it", text));
  if (auto clean = forget_what_came({}, until); !clean) return clean;
  if (mute()) return halted();
  in_step_ = false;
  return send(text + "\n");
}

/// What a line means as the answer to a command; empty when it is none: a late status report, a
/// message, a setting.
std::optional<Result<void>> GrblLink::answer_in(const grbl::Line& line, const std::string& text) {
  switch (line.kind) {
    case grbl::Line::Kind::ok:
      in_step_ = true;
      return Result<void>{};
    case grbl::Line::Kind::error:
      in_step_ = true;
      return fail(
          ErrorCode::refused,
          fmt::format("\"{}\": {}", text, with_meaning(line.text, grbl::error_text(line.number))));
    case grbl::Line::Kind::alarm:
      // A soft limit is followed by silence until a reset: do not wait for an ok.
      return fail(
          ErrorCode::refused,
          fmt::format("\"{}\": {}", text, with_meaning(line.text, grbl::alarm_text(line.number))));
    case grbl::Line::Kind::banner:
      in_step_ = true;  // whatever was owed is void
      return fail(ErrorCode::disconnected,
                  fmt::format("\"{}\": the controller restarted instead of answering", text));
    default:
      return std::nullopt;
  }
}

Result<void> GrblLink::command(const std::string& text, const Until& until) {
  if (auto begun = begin(text, until); !begun) return begun;
  for (;;) {
    auto line = next_line(until);
    if (!line) return tl::unexpected(line.error());
    if (!*line) return fail(ErrorCode::timed_out, fmt::format("\"{}\": no answer in time", text));
    if (auto answer = answer_in(**line, text)) {
      if ((*line)->kind == grbl::Line::Kind::error) acknowledge_error(until);
      return *answer;
    }
  }
}

// grblHAL answers every line with the error that was, and obeys none, until an empty one. Where
// that is not acknowledged the next command begins with a reset.
void GrblLink::acknowledge_error(const Until& until) {
  if (!hal_) return;
  in_step_ = false;
  if (!send("\n")) return;
  const Until soon{std::min(until.deadline, clock_->now() + acknowledge_patience), until.stop};
  while (!in_step_) {
    const auto line = next_line(soon);
    if (!line || !*line) return;
    (void)answer_in(**line, "");
  }
}

// Some firmware answers no question while it homes, some says Home. Only one that says it is doing
// something else, and again a second later, has not heard.
Result<void> GrblLink::home(const Until& until) {
  const std::string text = "$H";
  if (auto begun = begin(text, until); !begun) return begun;
  for (int doing_else = 0; doing_else < 2;) {
    Until step = until;
    step.deadline = std::min(until.deadline, clock_->now() + homing_look);
    auto line = next_line(step);
    if (!line) return tl::unexpected(line.error());
    if (!*line) {
      if (clock_->now() >= until.deadline)
        return fail(ErrorCode::timed_out, "\"$H\": homing did not end in time");
      report_owed_ = true;
      if (auto asked = realtime('?'); !asked) return asked;
      continue;
    }
    if (auto answer = answer_in(**line, text)) {
      if ((*line)->kind == grbl::Line::Kind::error) acknowledge_error(until);
      return *answer;
    }
    if ((*line)->kind != grbl::Line::Kind::status) continue;
    report_owed_ = false;
    if (const auto report = grbl::parse_status((*line)->text))
      doing_else = report->state == "Home" ? 0 : doing_else + 1;
  }
  return fail(ErrorCode::timed_out,
              "\"$H\": the controller does not home: it never got the command");
}

Result<grbl::StatusReport> GrblLink::status(const Until& until) {
  if (until.stop.stop_requested()) return fail(ErrorCode::stopped, "stopped on request");
  if (clock_->now() >= until.deadline)
    return fail(ErrorCode::timed_out, "no time left to ask for a status report");
  const auto quiet = report_owed_ ? quiet_after_silence : std::chrono::milliseconds(0);
  if (auto clean = forget_what_came(quiet, until); !clean) return tl::unexpected(clean.error());
  if (mute()) return halted();
  report_owed_ = true;
  int asked = 0;
  Until ask_again = until;
  const auto ask = [&] {
    ++asked;
    ask_again.deadline = std::min(until.deadline, clock_->now() + report_patience);
    return realtime('?');
  };
  if (auto sent = ask(); !sent) return tl::unexpected(sent.error());
  std::string silence = "no status report in time";
  for (;;) {
    auto line = next_line(ask_again);
    if (!line) return tl::unexpected(line.error());
    if (!*line && clock_->now() >= until.deadline) return fail(ErrorCode::timed_out, silence);
    if (!*line) {
      if (auto sent = ask(); !sent) return tl::unexpected(sent.error());
      continue;
    }
    if (mute()) return halted();
    if ((*line)->kind == grbl::Line::Kind::banner)
      return fail(ErrorCode::disconnected, "the controller restarted");
    if ((*line)->kind != grbl::Line::Kind::status) continue;
    auto report = grbl::parse_status((*line)->text);
    if (!report) continue;  // damaged on the way: the next one tells
    if (report->work_offset) {
      // Every position hangs on it from then on: one report may be damaged, two agree.
      if (said_offset_ == *report->work_offset) work_offset_ = said_offset_;
      if (said_offset_ != *report->work_offset) work_offset_.clear();
      said_offset_ = *report->work_offset;
    }
    if (!report->machine_position && report->work_position &&
        report->work_position->size() == work_offset_.size()) {
      report->machine_position = report->work_position;
      for (std::size_t i = 0; i < work_offset_.size(); ++i)
        (*report->machine_position)[i] += work_offset_[i];
    }
    if (report->machine_position && report->machine_position->size() < axes_) {
      silence = fmt::format(
          "the controller reports {} axes, the rig file's letters need {}: \"{}\"; check the "
          "letters, and the cable",
          report->machine_position->size(), axes_, (*line)->text);
      continue;  // an axis that is missing is not at zero
    }
    if (report->machine_position) {
      report_owed_ = asked > 1;  // an earlier one may still come
      return *report;
    }
    // Work positions without their offset yet: it comes with one of the next reports.
    if (auto sent = ask(); !sent) return tl::unexpected(sent.error());
    asked = 1;
  }
}

Result<void> GrblLink::reset(const Until& until) {
  if (auto sent = realtime(soft_reset); !sent) return sent;
  mute_ = false;
  for (;;) {
    auto line = next_line(until);
    if (!line) return tl::unexpected(line.error());
    if (!*line)
      return fail(ErrorCode::timed_out,
                  "no banner: is this port a GRBL controller, and is the baud rate right?");
    if ((*line)->kind != grbl::Line::Kind::banner) continue;
    in_step_ = true;
    hal_ = (*line)->text.starts_with("GrblHAL");
    return {};
  }
}

void GrblLink::heed_alarm(int number) {
  alarm_ = number;
  mute_ = number == hard_limit || number == soft_limit;
}

tl::unexpected<Error> GrblLink::halted() const {
  return fail(ErrorCode::refused,
              with_meaning(fmt::format("ALARM:{}", alarm_), grbl::alarm_text(alarm_)));
}

Result<grbl::StatusReport> GrblLink::release(const Until& until) {
  bool was_reset = false;
  for (;;) {
    auto report = status(until);
    if (!report) return report;
    const bool held = report->state == "Hold" || report->state == "Door";
    if (!held || was_reset) return report;
    const bool slowing = report->substate > (report->state == "Door" ? 1 : 0);
    if (!slowing) {
      if (auto done = reset(until); !done) return tl::unexpected(done.error());
      was_reset = true;
    } else {
      clock_->sleep_until(clock_->now() + rest_poll, until.stop);
    }
  }
}

Result<std::map<int, double>> GrblLink::settings(const Until& until) {
  std::optional<std::map<int, double>> before;
  for (int reading = 0; reading < most_settings_readings; ++reading) {
    auto now = read_settings(until);
    if (now && before == *now) return now;
    if (now) {
      before = std::move(*now);
      continue;
    }
    // Its ok was lost: only a reset tells that nothing more comes.
    if (now.error().code != ErrorCode::timed_out || clock_->now() >= until.deadline) return now;
    before.reset();
    if (auto done = reset(until); !done) return tl::unexpected(done.error());
  }
  return fail(ErrorCode::timed_out,
              "\"$$\": no two readings of the settings agree; check the cable and its shield");
}

Result<std::map<int, double>> GrblLink::read_settings(const Until& until) {
  std::map<int, double> settings;
  if (auto begun = begin("$$", until); !begun) return tl::unexpected(begun.error());
  const Until soon{std::min(until.deadline, clock_->now() + settings_patience), until.stop};
  for (;;) {
    auto line = next_line(soon);
    if (!line) return tl::unexpected(line.error());
    if (!*line) return fail(ErrorCode::timed_out, "\"$$\": no answer in time");
    if ((*line)->kind == grbl::Line::Kind::setting) settings[(*line)->number] = (*line)->value;
    if (auto answer = answer_in(**line, "$$")) {
      if (!*answer) return tl::unexpected(answer->error());
      return settings;
    }
  }
}

}  // namespace lightrig
