#include "daemon/service/state.h"

namespace lightrig {
namespace {

using Next = std::optional<State>;

Next from_unarmed(Event event) {
  if (event == Event::arm) return State::armed;
  if (event == Event::abort) return State::unarmed;  // nothing to stop, and never an error
  if (event == Event::fault) return State::faulted;
  return {};
}

// `armed` and `done` differ only in whether a result stands to be read.
Next from_ready(Event event, State state) {
  switch (event) {
    case Event::disarm:
    case Event::abort:  // nothing moves, but whoever aborts wants it to stay so
      return State::unarmed;
    case Event::home:
      return State::homing;
    case Event::start:
      return State::planning;
    case Event::fault:
      return State::faulted;
    case Event::clear:
      return state == State::done ? Next(State::armed) : Next();
    default:
      return {};
  }
}

// While something is under way, abort and fault end it; else only its own end does.
Next from_work(Event event, Event its_end, State after) {
  if (event == its_end) return after;
  if (event == Event::abort) return State::aborted;
  if (event == Event::fault) return State::faulted;
  return {};
}

Next from_homing(Event event) {
  if (event == Event::halted) return State::unarmed;  // where the gantry stands is not known
  return from_work(event, Event::homed, State::armed);
}

Next from_planning(Event event) {
  if (event == Event::refused || event == Event::halted) return State::armed;  // nothing moved
  if (event == Event::captured) return State::reducing;  // resumed, with nothing left to capture
  return from_work(event, Event::planned, State::capturing);
}

Next from_capturing(Event event) {
  if (event == Event::pause || event == Event::halted) return State::paused;
  return from_work(event, Event::captured, State::reducing);
}

Next from_paused(Event event) {
  if (event == Event::resume) return State::capturing;
  if (event == Event::halted) return State::paused;
  // Stopped early while paused, or the disk that a reduction waited for has space again.
  return from_work(event, Event::captured, State::reducing);
}

Next from_reducing(Event event) {
  if (event == Event::pause) return State::paused;   // the disk is full
  if (event == Event::refused) return State::armed;  // no result, but the frames are stored
  return from_work(event, Event::reduced, State::done);
}

Next from_aborted(Event event) {
  if (event == Event::arm) return State::armed;  // arming is deliberate enough
  if (event == Event::clear) return State::unarmed;
  if (event == Event::abort) return State::aborted;
  if (event == Event::fault) return State::faulted;
  return {};
}

Next from_faulted(Event event) {
  if (event == Event::clear) return State::unarmed;
  if (event == Event::abort || event == Event::fault) return State::faulted;
  return {};
}

}  // namespace

std::optional<State> next(State state, Event event) {
  switch (state) {
    case State::unarmed:
      return from_unarmed(event);
    case State::armed:
    case State::done:
      return from_ready(event, state);
    case State::homing:
      return from_homing(event);
    case State::planning:
      return from_planning(event);
    case State::capturing:
      return from_capturing(event);
    case State::paused:
      return from_paused(event);
    case State::reducing:
      return from_reducing(event);
    case State::aborted:
      return from_aborted(event);
    case State::faulted:
      return from_faulted(event);
  }
  return {};
}

bool is_armed(State state) {
  return state != State::unarmed && state != State::aborted && state != State::faulted;
}

std::string_view remedy(State state) {
  switch (state) {
    case State::unarmed:
      return "arm the rig first (lightrig arm)";
    case State::aborted:
      return "arm the rig again (lightrig arm)";
    case State::faulted:
      return "mend the cause, then clear the fault (lightrig clear) and arm";
    case State::paused:
      return "resume, stop or abort the session first";
    default:
      return "wait for its end, or abort it";
  }
}

std::string_view name_of(State state) {
  switch (state) {
    case State::unarmed:
      return "unarmed";
    case State::armed:
      return "armed";
    case State::homing:
      return "homing";
    case State::planning:
      return "planning";
    case State::capturing:
      return "capturing";
    case State::paused:
      return "paused";
    case State::reducing:
      return "reducing";
    case State::done:
      return "done";
    case State::aborted:
      return "aborted";
    case State::faulted:
      return "faulted";
  }
  return "unknown";
}

std::string_view name_of(Event event) {
  constexpr std::array<std::string_view, all_events.size()> names{
      "arm",      "disarm",  "home",  "homed", "start", "planned", "pause", "resume",
      "captured", "reduced", "abort", "fault", "clear", "refused", "halted"};
  return names.at(static_cast<std::size_t>(event));
}

}  // namespace lightrig
