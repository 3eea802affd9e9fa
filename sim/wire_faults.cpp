#include "sim/wire_faults.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <numbers>
#include <utility>

#include "sim/world.h"

namespace lightrig::sim {
namespace {

using std::chrono::milliseconds;

constexpr std::array<std::pair<WireEffect, std::string_view>, 24> effects{{
    {WireEffect::silence, "silence"},
    {WireEffect::lost_answer, "lost_answer"},
    {WireEffect::exception, "exception"},
    {WireEffect::late, "late"},
    {WireEffect::duplicate, "duplicate"},
    {WireEffect::wrong_id, "wrong_id"},
    {WireEffect::truncated, "truncated"},
    {WireEffect::corrupted, "corrupted"},
    {WireEffect::short_reads, "short_reads"},
    {WireEffect::garbled_request, "garbled_request"},
    {WireEffect::closed, "closed"},
    {WireEffect::half_open, "half_open"},
    {WireEffect::unplug, "unplug"},
    {WireEffect::stall, "stall"},
    {WireEffect::nak, "nak"},
    {WireEffect::alarm, "alarm"},
    {WireEffect::limit, "limit"},
    {WireEffect::jam, "jam"},
    {WireEffect::slip, "slip"},
    {WireEffect::door, "door"},
    {WireEffect::e_stop, "e_stop"},
    {WireEffect::watchdog, "watchdog"},
    {WireEffect::reboot, "reboot"},
    {WireEffect::lamp_failure, "lamp_failure"},
}};

constexpr std::array<std::string_view, 3> wires{"gantry", "lamp", "camera"};

std::size_t index_of(Wire wire) { return static_cast<std::size_t>(wire); }

/// Spoils an answer, rather than the wire or the drives.
bool spoils_answer(WireEffect effect) { return effect <= WireEffect::closed; }
bool strikes_drives(WireEffect effect) {
  return effect >= WireEffect::alarm && effect != WireEffect::reboot;
}

template <class Number>
bool read_number(std::string_view text, Number& into) {
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), into);
  return error == std::errc() && end == text.data() + text.size();
}

tl::unexpected<Error> bad(std::string message) {
  return fail(ErrorCode::invalid_input, std::move(message));
}

// The word's value goes where its name says; false when it is not understood.
bool set_word(WireFault& fault, std::string_view name, std::string_view value) {
  const auto counted = [&](std::optional<std::uint64_t>& into) {
    std::uint64_t n = 0;
    if (!read_number(value, n) || n == 0) return false;
    into = n;
    return true;
  };
  const auto span = [&](milliseconds& into) {
    std::int64_t n = 0;
    if (!read_number(value, n) || n < 0) return false;
    into = milliseconds(n);
    return true;
  };
  if (name == "request") return counted(fault.request);
  if (name == "motion") return counted(fault.motion);
  if (name == "lit") return counted(fault.lit);
  if (name == "delay_ms") return span(fault.delay);
  if (name == "ms") return span(fault.duration);
  if (name == "count") return read_number(value, fault.count) && fault.count > 0;
  if (name == "unit") {
    int n = 0;
    if (!read_number(value, n) || n < 0 || n > 255) return false;
    fault.unit = n;
    return true;
  }
  if (name == "code") return read_number(value, fault.code) && fault.code >= 0;
  if (name == "degrees") return read_number(value, fault.degrees);
  if (name == "time") {
    double seconds = 0;
    if (!read_number(value, seconds) || !(seconds >= 0)) return false;
    fault.time = seconds;
    return true;
  }
  if (name == "axis") {
    fault.axis = value;
    return !value.empty();
  }
  if (name != "wire") return false;
  const auto wire = std::find(wires.begin(), wires.end(), value);
  if (wire == wires.end()) return false;
  fault.wire = static_cast<Wire>(wire - wires.begin());
  return true;
}

}  // namespace

std::string_view name_of(WireEffect effect) {
  for (const auto& [one, name] : effects)
    if (one == effect) return name;
  return "?";
}

std::optional<WireEffect> wire_effect(std::string_view name) {
  for (const auto& [effect, one] : effects)
    if (one == name) return effect;
  return std::nullopt;
}

Result<WireFault> parse_wire_fault(std::string_view line) {
  WireFault fault;
  bool first = true;
  while (!line.empty()) {
    const std::size_t begin = line.find_first_not_of(" \t\r");
    if (begin == std::string_view::npos) break;
    line.remove_prefix(begin);
    const std::string_view word = line.substr(0, line.find_first_of(" \t\r"));
    line.remove_prefix(word.size());
    if (std::exchange(first, false)) {
      const auto effect = wire_effect(word);
      if (!effect) {
        std::string names;
        for (const auto& [one, name] : effects)
          names += (names.empty() ? "" : ", ") + std::string(name);
        return bad(fmt::format("there is no fault \"{}\"; there are {}, and the camera's own", word,
                               names));
      }
      fault.effect = *effect;
      continue;
    }
    const std::size_t equals = word.find('=');
    if (equals == std::string_view::npos ||
        !set_word(fault, word.substr(0, equals), word.substr(equals + 1)))
      return bad(fmt::format(
          "\"{}\" is not understood; a fault reads: EFFECT [wire=gantry|lamp|camera] "
          "[request=N | motion=N | lit=N | time=S] [delay_ms=N] [count=N] [unit=N] [ms=N] "
          "[code=N] [axis=NAME] [degrees=X]",
          word));
  }
  if (first) return bad("an empty line is no fault");
  return fault;
}

WireFaults::WireFaults(std::shared_ptr<World> world) : world_(std::move(world)) {}

Result<void> WireFaults::add(WireFault fault) {
  const Rig& rig = world_->rig();
  const auto& axes = rig.gantry.model.axes;
  if (!fault.axis.empty() && std::none_of(axes.begin(), axes.end(), [&](const Axis& axis) {
        return axis.name == fault.axis;
      }))
    return bad(fmt::format("the rig has no axis \"{}\"", fault.axis));
  if (fault.effect == WireEffect::door && rig.interlocks.empty())
    return bad("the rig has no interlock that could open");
  const std::lock_guard lock(mutex_);
  Waiting waiting;
  if (fault.request) waiting.request = requests_[index_of(fault.wire)] + *fault.request;
  if (fault.motion) waiting.motion = motions_ + *fault.motion;
  if (fault.lit) waiting.lit = lit_ + *fault.lit;
  waiting.time = world_->clock().now();
  if (fault.time) waiting.time += std::chrono::nanoseconds(std::llround(*fault.time * 1e9));
  waiting.left = fault.count;
  // Whatever it waits for, time runs from then on.
  waiting.due = !fault.request && !fault.motion && !fault.lit;
  if (waiting.due) waiting.time += fault.delay;
  waiting.fault = std::move(fault);
  waiting_.push_back(std::move(waiting));
  return {};
}

void WireFaults::say(Waiting& waiting) {
  if (std::exchange(waiting.said, true)) return;
  const std::size_t wire = index_of(waiting.fault.wire);
  struck_.push_back(fmt::format("{} on the {}'s wire at request {}", name_of(waiting.fault.effect),
                                wires[wire], requests_[wire]));
}

void WireFaults::strike(const WireFault& fault) {
  const auto open = [&](const std::string& name) {
    world_->set_interlock(name, true);
    if (fault.duration.count() > 0)
      closing_.emplace_back(world_->clock().now() + fault.duration, name);
  };
  switch (fault.effect) {
    case WireEffect::alarm:
      return world_->raise_alarm(fmt::format("code {}", fault.code));
    case WireEffect::limit:
      return world_->raise_alarm("limit switch");
    case WireEffect::watchdog:
      static_cast<void>(world_->set_lamp(0));
      return world_->raise_alarm("communication watchdog");
    case WireEffect::jam:
      return world_->halt_gantry();
    case WireEffect::door:
      return open(world_->rig().interlocks.front().name);
    case WireEffect::e_stop:
      return open("e_stop");
    case WireEffect::lamp_failure:
      return static_cast<void>(world_->set_lamp(0));
    case WireEffect::slip: {
      const auto& axes = world_->rig().gantry.model.axes;
      std::size_t axis = 0;
      for (std::size_t i = 0; i < axes.size(); ++i)
        if (axes[i].name == fault.axis) axis = i;
      return world_->slip(
          axis, axes[axis].rotary ? fault.degrees * std::numbers::pi / 180 : fault.degrees / 1000);
    }
    default:
      return;
  }
}

// What the laboratory has come to since the last look, and what is due by it.
void WireFaults::look() {
  const TimePoint now = world_->clock().now();
  const bool moving = !world_->gantry_status().at_rest;
  const bool lit = world_->lamp_power() > 0;
  if (moving && !was_moving_) ++motions_;
  if (lit && !was_lit_) ++lit_;
  was_moving_ = moving;
  was_lit_ = lit;
  for (Waiting& one : waiting_) {
    if (one.due) continue;
    one.due = (one.request > 0 && requests_[index_of(one.fault.wire)] >= one.request) ||
              (one.motion > 0 && motions_ >= one.motion) || (one.lit > 0 && lit_ >= one.lit);
    if (one.due) one.time = now + one.fault.delay;
  }
  for (auto one = waiting_.begin(); one != waiting_.end();) {
    if (!one->due || now < one->time || !strikes_drives(one->fault.effect)) {
      ++one;
      continue;
    }
    say(*one);
    strike(one->fault);
    one = waiting_.erase(one);
  }
  while (!closing_.empty() && closing_.front().first <= now) {
    world_->set_interlock(closing_.front().second, false);
    closing_.pop_front();
  }
}

std::optional<WireFault> WireFaults::take(Wire wire, bool answer, int unit) {
  const TimePoint now = world_->clock().now();
  for (auto one = waiting_.begin(); one != waiting_.end(); ++one) {
    if (!one->due || now < one->time || one->fault.wire != wire ||
        strikes_drives(one->fault.effect) || spoils_answer(one->fault.effect) != answer ||
        (answer && one->fault.unit && *one->fault.unit != unit))
      continue;
    say(*one);
    WireFault fault = one->fault;
    if (--one->left <= 0) waiting_.erase(one);
    return fault;
  }
  return std::nullopt;
}

std::optional<WireFault> WireFaults::on_request(Wire wire, int unit) {
  const std::lock_guard lock(mutex_);
  ++requests_[index_of(wire)];
  look();
  return take(wire, true, unit);
}

std::optional<WireFault> WireFaults::tick(Wire wire) {
  const std::lock_guard lock(mutex_);
  look();
  return take(wire, false, 0);
}

std::vector<std::string> WireFaults::struck() const {
  const std::lock_guard lock(mutex_);
  return struck_;
}

std::uint64_t WireFaults::requests(Wire wire) const {
  const std::lock_guard lock(mutex_);
  return requests_[index_of(wire)];
}

}  // namespace lightrig::sim
