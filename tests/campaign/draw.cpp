// Which faults there are, and which of them a campaign takes.
#include <fmt/format.h>

#include <cstdio>
#include <cstdlib>
#include <random>

#include "tests/campaign/trial.h"

namespace lightrig::campaign {
namespace {

using Words = std::vector<std::string>;

Words all_of(std::initializer_list<Words> lists) {
  Words words;
  for (const Words& list : lists) words.insert(words.end(), list.begin(), list.end());
  return words;
}

// What the stated times are made of: a session of some 4 s; of the policy, three tries of a step,
// each at most 10 s of waiting for rest or 2 s a question, two reopenings, one homing.
std::vector<WireKind> make_wire_kinds() {
  const Words answers{"silence",   "lost_answer", "exception", "late",
                      "duplicate", "truncated",   "corrupted", "short_reads"};
  const Words drives{"alarm", "limit", "jam", "slip", "door", "e_stop", "reboot", "lamp_failure"};
  const Words modbus{"wrong_id", "unplug", "watchdog"};
  return {
      {"tcp", "wire_modbus_tcp.toml", false, 30,
       all_of({answers, drives, modbus, {"closed", "half_open"}})},
      {"rtu", "wire_modbus_rtu.toml", false, 30, all_of({answers, drives, modbus})},
      {"grbl", "wire_grbl.toml", false, 45,
       all_of({answers, drives, {"unplug", "garbled_request"}})},
      {"usb", "wire_usb.toml", true, 45,
       all_of({answers, drives, {"unplug", "stall", "nak", "garbled_request"}})},
      {"lamp", "wire_modbus_tcp.toml", false, 30,
       all_of({answers, {"wrong_id", "closed", "half_open", "unplug", "reboot", "lamp_failure"}})},
      {"camera",
       "wire_modbus_tcp.toml",
       false,
       60,
       {"packet_lost", "packet_gone", "leader_gone", "trailer_lost", "packets_reordered",
        "packets_doubled", "frozen", "rebooted", "privilege_stolen", "wrong_exposure",
        "stale_frame", "wrong_size"}}};
}

}  // namespace

void die(const std::string& why) {
  std::fprintf(stderr, "fault_campaign: %s\n", why.c_str());
  std::fflush(nullptr);
  std::_Exit(2);  // other trials may be under way on other threads
}

const std::vector<WireKind>& wire_kinds() {
  static const std::vector<WireKind> kinds = make_wire_kinds();
  return kinds;
}

const WireKind& wire_kind(const std::string& name) {
  std::string names;
  for (const WireKind& kind : wire_kinds()) {
    if (kind.name == name) return kind;
    names += (names.empty() ? "" : ", ") + kind.name;
  }
  die(fmt::format("there is no wire \"{}\"; there are {}", name, names));
}

Trial draw(std::uint64_t seed, int n, const std::vector<WireKind>& kinds,
           const std::vector<Clean>& clean) {
  std::mt19937_64 chance(seed * 1000003 + static_cast<std::uint64_t>(n));
  const auto below = [&](std::uint64_t most) {
    return std::uniform_int_distribution<std::uint64_t>(0, most - 1)(chance);
  };
  const std::size_t which = static_cast<std::size_t>(n) % kinds.size();
  const WireKind& kind = kinds[which];
  const Clean& known = clean[which];
  // Another seed begins elsewhere in the round, so that a short campaign is not always the same.
  const std::size_t round = static_cast<std::size_t>(n) / kinds.size() + 7 * (seed + which);
  const std::string& effect = kind.effects[round % kind.effects.size()];
  const std::uint64_t trial_seed = 1 + below(1000);
  if (kind.name == "camera")
    return {kind.name,
            fmt::format("{} frame={} seconds={:.1f}", effect, 1 + below(known.frames),
                        0.5 + 0.1 * static_cast<double>(below(60))),
            trial_seed};
  std::string moment;
  switch (below(5)) {
    case 0:
    case 1:
      moment = fmt::format("request={}", 1 + below(known.requests));
      break;
    case 2:
      moment = fmt::format("motion={} delay_ms={}", 1 + below(known.shots + 1), below(300));
      break;
    case 3:
      moment = fmt::format("lit={} delay_ms={}", 1 + below(known.shots), below(200));
      break;
    default:
      moment = fmt::format("time={:.3f}", known.seconds * static_cast<double>(below(1000)) / 1000);
  }
  const bool is_grbl = kind.name == "grbl" || kind.name == "usb";
  std::string rest;
  if (effect == "slip")
    rest = fmt::format(" degrees={}", 0.05 * static_cast<double>(1 + below(100)));
  if (effect == "late") rest = fmt::format(" ms={}", 150 + below(400));
  if (effect == "alarm") rest = fmt::format(" code={}", is_grbl ? 1 + below(3) : 16);
  if (effect == "door" || effect == "e_stop") rest = below(2) == 0 ? " ms=0" : " ms=400";
  if (effect == "silence" || effect == "lost_answer") rest = fmt::format(" count={}", 1 + below(4));
  if (effect == "unplug" || effect == "reboot") rest = fmt::format(" ms={}", 200 + below(1500));
  if (kind.name == "lamp") rest += " wire=lamp";
  return {kind.name, effect + " " + moment + rest, trial_seed};
}

}  // namespace lightrig::campaign
