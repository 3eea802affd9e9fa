#pragma once

#include <cstdint>
#include <optional>
#include <string_view>

namespace lightrig {

/// What the service is doing. Nothing moves in `unarmed`.
enum class State : std::uint8_t {
  unarmed,
  armed,
  homing,
  planning,
  capturing,
  paused,
  reducing,
  done,
  aborted,
  faulted
};

/// What may happen to it.
enum class Event : std::uint8_t {
  arm,
  disarm,
  home,
  homed,
  start,
  planned,
  pause,
  resume,
  captured,
  reduced,
  abort,
  fault,
  clear
};

/// The state after an event; empty where the event is not legal in that state. The whole machine,
/// in one function.
std::optional<State> next(State state, Event event);

std::string_view name_of(State state);
std::string_view name_of(Event event);

}  // namespace lightrig
