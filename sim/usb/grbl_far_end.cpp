#include "sim/usb/grbl_far_end.h"

#include <fmt/format.h>

#include <algorithm>

namespace lightrig::sim {
namespace {

using std::chrono::milliseconds;
using std::chrono::steady_clock;

constexpr int locked = 9;  ///< error:9, G-code locked out

/// "X12.5" becomes "X1.5": GRBL's lines have no checksum. What has no such word is cut in its
/// middle.
std::string garbled(std::string_view bytes) {
  std::string left(bytes);
  const std::size_t word = left.find_first_of("XYZABCS");
  const std::size_t at = word == std::string::npos ? left.size() / 2 : word + 2;
  if (at < left.size() && left[at] != '\n') left.erase(at, 1);
  return left;
}

}  // namespace

void GrblFarEnd::say(std::string bytes, milliseconds delay) {
  if (!bytes.empty()) outbox_.push_back({steady_clock::now() + delay, std::move(bytes)});
}

void GrblFarEnd::spoil(std::string said, const WireFault& fault) {
  switch (fault.effect) {
    case WireEffect::lost_answer:
    case WireEffect::closed:
      return;
    case WireEffect::late:
      return say(std::move(said), fault.duration);
    case WireEffect::duplicate:
      say(said);
      return say(std::move(said));
    case WireEffect::truncated:
      return say(said.substr(0, said.size() / 2));
    case WireEffect::corrupted:
      // One bit of one character, which may turn one digit into another: GRBL has no checksum.
      if (!said.empty()) said[said.size() / 2] = static_cast<char>(said[said.size() / 2] ^ 0x01);
      return say(std::move(said));
    case WireEffect::short_reads:
      for (std::size_t i = 0; i < said.size(); ++i)
        say(said.substr(i, 1), static_cast<long>(i) * milliseconds(1));
      return;
    default:
      return say(std::move(said));
  }
}

void GrblFarEnd::receive(std::string_view bytes) {
  const auto fault = faults_ ? faults_->on_request(wire_) : std::nullopt;
  if (steady_clock::now() < silent_until_) return;
  if (!fault) return say(machine_.receive(bytes));
  if (fault->effect == WireEffect::silence) return;
  if (fault->effect == WireEffect::garbled_request) return say(machine_.receive(garbled(bytes)));
  if (fault->effect == WireEffect::exception) {
    const auto lines = std::count(bytes.begin(), bytes.end(), '\n');
    for (long i = 0; i < lines; ++i)
      say(fmt::format("error:{}\r\n", fault->code > 0 ? fault->code : locked));
    return;
  }
  spoil(machine_.receive(bytes), *fault);
}

std::optional<WireFault> GrblFarEnd::tick() {
  auto fault = faults_ ? faults_->tick(wire_) : std::nullopt;
  const auto now = steady_clock::now();
  if (fault && fault->effect == WireEffect::reboot) {
    outbox_.clear();
    silent_until_ = now + fault->duration;
    booting_ = true;
    const std::string banner = machine_.power_cycle();
    say(banner, fault->duration);
    fault.reset();
  }
  if (booting_ && now >= silent_until_) booting_ = false;
  if (!booting_) say(machine_.tick());
  return fault;
}

bool GrblFarEnd::has_something_to_say() const {
  const auto now = steady_clock::now();
  return std::any_of(outbox_.begin(), outbox_.end(),
                     [&](const Late& late) { return late.time <= now; });
}

std::string GrblFarEnd::take(std::size_t most) {
  const auto now = steady_clock::now();
  std::string due;
  for (auto one = outbox_.begin(); one != outbox_.end() && due.size() < most;) {
    if (one->time > now) {
      ++one;
      continue;
    }
    const std::size_t share = std::min(most - due.size(), one->bytes.size());
    due += one->bytes.substr(0, share);
    one->bytes.erase(0, share);
    if (one->bytes.empty()) one = outbox_.erase(one);
  }
  return due;
}

}  // namespace lightrig::sim
