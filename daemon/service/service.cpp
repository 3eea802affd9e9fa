#include "daemon/service/service.h"

#include <fmt/format.h>

#include <utility>

#include "daemon/service/status_json.h"

namespace lightrig {
namespace {

constexpr std::size_t records_kept = 16;

// An id that no session has yet: two may begin in one second, and a clock that is set back tells
// the same time again.
std::string free_id(const std::filesystem::path& root, const SessionSpec& spec) {
  const std::string first = make_session_id(spec, std::chrono::system_clock::now());
  std::string id = first;
  std::error_code error;
  for (int n = 2; std::filesystem::exists(root / id, error); ++n)
    id = fmt::format("{}-{}", first, n);
  return id;
}

}  // namespace

Service::Service(ServiceSettings settings, const Log& log, EventHub& hub, Liveness& liveness)
    : settings_(std::move(settings)),
      log_(log),
      hub_(hub),
      liveness_(liveness),
      preview_(settings_.rig.camera.sensor),
      access_(settings_.rig, settings_.simulate, settings_.clock_rate),
      object_(settings_.rig.session_defaults.object) {
  look_at_disk();
  tell_state();
  thread_ = std::thread([this] { run(); });
}

Service::~Service() { shut_down(); }

void Service::shut_down() {
  {
    const std::lock_guard lock(mutex_);
    stopping_ = true;
    slot_.reset();
    if (active_ != nullptr) active_->halt("the service was stopped");
  }
  changed_.notify_all();
  if (thread_.joinable()) thread_.join();
}

// --- the slot and the state ---------------------------------------------------------------------

Result<std::uint64_t> Service::submit(const std::string& name, const Caller& caller, Event event,
                                      bool now, Work work, std::optional<SessionView> session,
                                      const std::string& key) {
  std::uint64_t id = 0;
  {
    const std::lock_guard lock(mutex_);
    // A request that is repeated is answered as the first one was, whatever has become of it.
    if (const auto last = last_keyed_.find(name);
        !key.empty() && last != last_keyed_.end() && last->second.key == key)
      return last->second.id;
    const auto after = next(state_, event);
    if (!after)
      return fail(ErrorCode::refused,
                  fmt::format("cannot {} while {}; {}", name, name_of(state_), remedy(state_)));
    if (stopping_) return fail(ErrorCode::refused, "the service is stopping");
    if (active_ != nullptr || slot_)
      return fail(ErrorCode::refused,
                  fmt::format("cannot {} yet: {} has not ended; try again in a moment", name,
                              commands_.empty() ? "the last command" : commands_.back().name));
    id = ++last_id_;
    if (session) {
      session_ = std::move(session);
      session_in_hand_ = true;
    }
    if (now) set_state(*after, "");
    slot_ = Command{id, name, std::move(work), std::make_unique<SessionControl>()};
    keep_record({id, name, "running", ""});
    if (!key.empty()) last_keyed_[name] = {key, id};
  }
  changed_.notify_all();
  log_.info("command", {{"command", name}, {"by", caller.name}, {"peer", caller.peer}});
  tell_state();
  return id;
}

Result<std::uint64_t> Service::done_already(const std::string& name, const std::string& message) {
  const std::lock_guard lock(mutex_);
  keep_record({++last_id_, name, "done", message});
  return last_id_;
}

void Service::keep_record(CommandRecord record) {
  commands_.push_back(std::move(record));
  if (commands_.size() > records_kept) commands_.pop_front();
}

void Service::drop_waiting(const std::string& why) {
  if (!slot_) return;
  for (CommandRecord& one : commands_)
    if (one.id == slot_->id) (one.state = "failed", one.message = why);
  slot_.reset();
}

void Service::set_state(State state, const std::string& given, const SessionWords& words) {
  // Whoever read an ABORT's reason before it was explained brings the shorter one.
  const bool explained = !aborted_.explained.empty() && given == aborted_.given;
  const std::string reason = explained ? aborted_.explained : given;
  if (state != state_) {
    state_since_ = SteadyClock::now();
    // A fault and an ABORT have a line of their own.
    if (state != State::faulted && state != State::aborted)
      log_.info("state", {{"from", std::string(name_of(state_))},
                          {"to", std::string(name_of(state))},
                          {"reason", reason}});
  }
  state_ = state;
  state_reason_ = reason;
  if (session_in_hand_) {
    session_->state = words.state.empty() ? std::string(name_of(state)) : words.state;
    session_->reason = reason;
    session_->paused_by = state == State::paused ? words.paused_by : "";
  }
  settle_steering();
}

bool Service::apply(Event event, const std::string& reason, const SessionWords& words) {
  State before{};
  {
    const std::lock_guard lock(mutex_);
    const auto to = next(state_, event);
    if (!to) return false;
    before = state_;
    if (event == Event::fault) {
      ++faults_;
      drop_waiting("not begun: " + reason);
    }
    set_state(*to, reason, words);
    session_in_hand_ = session_in_hand_ && (active_ != nullptr || slot_.has_value());
  }
  if (event == Event::fault)
    log_.error("fault", {{"while", std::string(name_of(before))}, {"reason", reason}});
  tell_state();
  return true;
}

// An abort that came while the work was being done wins over the work's end.
bool Service::apply_unless_stopped(Event event, const SessionControl& control) {
  {
    const std::lock_guard lock(mutex_);
    const auto to = next(state_, event);
    if (!to || control.stop_token().stop_requested()) return false;
    set_state(*to, "");
  }
  tell_state();
  return true;
}

void Service::record_end(std::uint64_t id, const Result<std::string>& end) {
  CommandRecord record;
  {
    const std::lock_guard lock(mutex_);
    for (CommandRecord& one : commands_)
      if (one.id == id) {
        one.state = end ? "done" : "failed";
        one.message = end ? *end : end.error().message;
        record = one;
      }
  }
  if (end)
    log_.info("command_done", {{"command", record.name}, {"outcome", record.message}});
  else
    log_.warning("command_failed", {{"command", record.name},
                                    {"code", std::string(name_of(end.error().code))},
                                    {"reason", record.message}});
  tell_state();
}

void Service::tell_state() { hub_.update("state", status_json(snapshot())); }

// --- commands -----------------------------------------------------------------------------------

Result<std::uint64_t> Service::arm(const Caller& caller) {
  if (is_armed(snapshot().state)) return done_already("arm", "the rig is armed already");
  return submit("arm", caller, Event::arm, false,
                [this](SessionControl& control) { return do_arm(control); });
}

Result<std::uint64_t> Service::disarm(const Caller& caller) {
  if (snapshot().state == State::unarmed) return done_already("disarm", "the rig is unarmed");
  // The devices are given back by the session thread once the state says unarmed.
  return submit("disarm", caller, Event::disarm, true,
                [](SessionControl&) -> Result<std::string> { return "the rig is unarmed"; });
}

Result<std::uint64_t> Service::clear(const Caller& caller) {
  const State state = snapshot().state;
  if (state == State::unarmed || state == State::armed)
    return done_already("clear", "nothing stands in the way");
  return submit("clear", caller, Event::clear, true,
                [](SessionControl&) -> Result<std::string> { return "cleared"; });
}

Result<std::uint64_t> Service::home(const Caller& caller) {
  return submit("home", caller, Event::home, true,
                [this](SessionControl& control) { return do_home(control); });
}

Result<std::uint64_t> Service::jog(const Caller& caller, const std::string& axis, double value,
                                   bool relative, const std::string& key) {
  // Jogging is legal exactly where homing is; the state does not change by it.
  return submit(
      "jog", caller, Event::home, false,
      [this, axis, value, relative](SessionControl& control) {
        return do_jog(control, axis, value, relative);
      },
      {}, key);
}

Result<std::uint64_t> Service::lamp(const Caller& caller, double power, const std::string& key) {
  // Legal where jogging is: the rig is armed and does nothing else.
  return submit(
      "lamp", caller, Event::home, false,
      [this, power](SessionControl& control) { return do_lamp(control, power); }, {}, key);
}

Result<std::uint64_t> Service::snap(const Caller& caller, double exposure, bool lit,
                                    const std::string& key) {
  return submit(
      "snap", caller, Event::home, false,
      [this, exposure, lit](SessionControl& control) { return do_snap(control, exposure, lit); },
      {}, key);
}

Result<std::string> Service::start(const Caller& caller, StartRequest request) {
  const std::string id = free_id(settings_.rig.session_root, request.spec);
  {
    const std::lock_guard lock(mutex_);
    if (!request.key.empty() && request.key == last_start_.key) return last_start_.id;
  }
  const std::string key = request.key;
  SessionView view;
  view.id = id;
  view.state = std::string(name_of(State::planning));
  auto accepted = submit(
      "start", caller, Event::start, true,
      [this, id, request = std::move(request)](SessionControl& control) {
        return do_session(control, id, request);
      },
      std::move(view));
  if (!accepted) return tl::unexpected(accepted.error());
  log_.info("session", {{"id", id}, {"by", caller.name}});
  const std::lock_guard lock(mutex_);
  last_start_ = {key, id};
  return id;
}

void Service::abort(const Caller& caller, const std::string& reason) {
  State before{};
  {
    const std::lock_guard lock(mutex_);
    if (active_ != nullptr) active_->abort(reason);
    before = state_;
    ++aborts_;
    // In hand from when it was asked for: the session thread may not have begun it yet.
    const bool of_a_session =
        session_ && (session_in_hand_ || (active_ == nullptr && before == State::paused));
    aborted_ = {active_, of_a_session ? session_->id : "", reason, ""};
    drop_waiting("aborted before it began");
    set_state(*next(state_, Event::abort), reason);
    session_in_hand_ = session_in_hand_ && active_ != nullptr;
    // One that waited had been given back: nobody else says that it waits no more.
    if (before == State::paused && active_ == nullptr && session_) {
      session_->state = std::string(name_of(State::aborted));
      session_->paused_by.clear();
    }
  }
  changed_.notify_all();
  log_.warning("abort", {{"while", std::string(name_of(before))},
                         {"by", caller.name},
                         {"peer", caller.peer},
                         {"reason", reason}});
  tell_state();
}

void Service::explain_abort(const Caller& caller, const std::string& given,
                            const std::string& why) {
  const std::string reason = given + ": " + why;
  {
    const std::lock_guard lock(mutex_);
    // Its words may come seconds after it: whatever has begun since is none of its concern.
    if (active_ != nullptr && active_ == aborted_.command) {
      active_->abort(reason);
      if (given == aborted_.given) aborted_.explained = reason;
    }
    if (state_reason_ == given) state_reason_ = reason;
    if (session_ && session_->id == aborted_.session && session_->reason == given)
      session_->reason = reason;
  }
  log_.info("abort_reason", {{"by", caller.name}, {"reason", why}});
  tell_state();
}

}  // namespace lightrig
