// An operator's hand on the session under way: pause, resume, stop, halt, each with a deadline and
// an outcome that `commands` tells.
#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <string>
#include <utility>

#include "daemon/service/service.h"
#include "daemon/service/status_json.h"
#include "daemon/session/session_upkeep.h"

namespace lightrig {
namespace {

using namespace std::chrono_literals;

constexpr std::chrono::seconds soon = 60s, at_once = 30s;

/// A stop waits for the light in hand: a minute, and three times what a light is predicted to take.
std::chrono::seconds time_for(SessionVerb verb, const SessionProgress& progress) {
  if (verb == SessionVerb::halt) return at_once;
  if (verb != SessionVerb::stop) return soon;
  const double light =
      progress.remaining_s / std::max(1, progress.shots_total - progress.shots_done);
  return soon + std::chrono::seconds(std::llround(3 * std::max(0.0, light)));
}

/// Whether what was asked for has come; `over`: the session is no longer in hand.
bool has_come(SessionVerb verb, State state, bool over) {
  switch (verb) {
    case SessionVerb::pause:
      return state == State::paused;
    case SessionVerb::resume:
      return state == State::capturing || state == State::reducing;
    case SessionVerb::stop:
      return state == State::reducing || over;
    default:
      return over;
  }
}

}  // namespace

std::string_view name_of(SessionVerb verb) {
  switch (verb) {
    case SessionVerb::pause:
      return "pause";
    case SessionVerb::resume:
      return "resume";
    case SessionVerb::stop:
      return "stop";
    case SessionVerb::halt:
      return "halt";
    case SessionVerb::abort:
      return "abort";
  }
  return "unknown";
}

// The session outlives its command; what runs after it is none of its business.
SessionControl* Service::control_of(const std::string& id) const {
  if (!session_in_hand_ || session_->id != id) return nullptr;
  return active_ != nullptr ? active_ : slot_ ? slot_->control.get() : nullptr;
}

Result<std::uint64_t> Service::steer_in_hand(SessionControl& control, const std::string& by,
                                             SessionVerb verb) {
  if (state_ == State::reducing && (verb == SessionVerb::pause || verb == SessionVerb::halt))
    return fail(
        ErrorCode::refused,
        fmt::format("cannot {}: everything is captured and nothing moves, its frames become "
                    "a result; {}",
                    name_of(verb), remedy(state_)));
  switch (verb) {
    case SessionVerb::pause:
      session_->pause_requested = true;
      control.pause("paused by " + by);
      break;
    case SessionVerb::resume:
      session_->pause_requested = false;
      control.resume();
      break;
    case SessionVerb::halt:
      control.halt("halted by " + by);
      break;
    default:
      session_->stop_requested = true;
      control.stop_after_shot();
      control.resume();  // a paused session ends too: its shot is done
  }
  const std::chrono::seconds within = time_for(verb, session_->progress);
  keep_record({++last_id_, std::string(name_of(verb)), "running", ""});
  steering_.push_back({last_id_, verb, SteadyClock::now() + within, within});
  settle_steering();
  return last_id_;
}

/// Tells of what was asked for whether it has come, or cannot any more, or should have.
void Service::settle_steering() {
  const bool over = !session_in_hand_ || (active_ == nullptr && !slot_);
  const auto now = SteadyClock::now();
  std::erase_if(steering_, [&](const Steering& one) {
    const bool come = has_come(one.verb, state_, over);
    if (!come && !over && now <= one.until) return false;
    const auto record = std::ranges::find(commands_, one.id, &CommandRecord::id);
    if (record == commands_.end()) return true;
    record->state = come ? "done" : "failed";
    record->message = fmt::format("the session is {}", name_of(state_));
    if (over && !come) record->message = "the session ended first: " + record->message;
    if (!over && !come)
      record->message =
          fmt::format("not so after {} s: {} ({}); an ABORT stops everything", one.within.count(),
                      record->message, session_->progress.activity);
    return true;
  });
}

Result<std::uint64_t> Service::steer(const Caller& caller, const std::string& id,
                                     SessionVerb verb) {
  if (verb == SessionVerb::abort) {
    abort(caller, "aborted by " + caller.name);
    return done_already("abort", "aborted");
  }
  const auto log = [&] {
    log_.info("command", {{"command", std::string(name_of(verb))},
                          {"session", id},
                          {"by", caller.name},
                          {"peer", caller.peer}});
  };
  {
    const std::lock_guard lock(mutex_);
    if (SessionControl* control = control_of(id)) {
      log();
      return steer_in_hand(*control, caller.name, verb);
    }
  }
  if (verb != SessionVerb::resume) log();
  if (verb != SessionVerb::resume)
    return fail(ErrorCode::refused,
                fmt::format("cannot {} session {}: it is not under way", name_of(verb), id));
  const std::filesystem::path folder = settings_.rig.session_root / id;
  if (is_finished({folder}))
    return fail(ErrorCode::refused,
                "resume: the session is done; its result stands in its folder "
                "(lightrig reduce computes it again)");
  // A session that capture() has given back to wait for its condition is resumed from `paused`.
  const Event event = snapshot().state == State::paused ? Event::resume : Event::start;
  SessionView view;
  view.id = id;
  view.folder = folder;
  view.state = std::string(name_of(State::planning));
  {
    const std::lock_guard lock(mutex_);
    if (session_ && session_->id == id) view.curve = session_->curve;
  }
  return submit(
      "resume", caller, event, true,
      [this, folder](SessionControl& control) { return do_resume(control, folder); },
      std::move(view));
}

}  // namespace lightrig
