#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string_view>

namespace lightrig {

/// What the service is doing. Nothing moves in `unarmed`.
enum class State : std::uint8_t {
  unarmed,    ///< no device is open; nothing can move
  armed,      ///< devices open, waiting; a person has said that the rig may move
  homing,     ///< the gantry looks for its reference
  planning,   ///< choosing lights; nothing moves yet
  capturing,  ///< a session is moving and exposing
  paused,     ///< a session waits: for a person, a condition, or disk space
  reducing,   ///< frames become a BRDF; nothing moves
  done,       ///< a session has ended with a result; still armed
  aborted,    ///< a person aborted; arm again to go on
  faulted,    ///< something failed; clear the fault first
};
inline constexpr std::array all_states{
    State::unarmed, State::armed,    State::homing, State::planning, State::capturing,
    State::paused,  State::reducing, State::done,   State::aborted,  State::faulted};

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
  clear,    ///< a person puts aside what stands in the way: a result, an abort, a fault
  refused,  ///< a plan was refused, or a reduction failed: the rig is sound
  halted,   ///< a halt ended what was under way; nobody aborted, nothing failed
};
inline constexpr std::array all_events{Event::arm,      Event::disarm,  Event::home,  Event::homed,
                                       Event::start,    Event::planned, Event::pause, Event::resume,
                                       Event::captured, Event::reduced, Event::abort, Event::fault,
                                       Event::clear,    Event::refused, Event::halted};

/// The state after an event; empty where the event is not legal in that state. The whole machine,
/// in one function.
std::optional<State> next(State state, Event event);

/// True in the states in which a person has said that the rig may move.
bool is_armed(State state);

/// What a person can do about the service being in this state.
std::string_view remedy(State state);

std::string_view name_of(State state);
std::string_view name_of(Event event);

}  // namespace lightrig
