// One session on the session thread: plan, capture, reduce.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "config/json_text.h"
#include "core/brdf_table.h"
#include "daemon/service/service.h"
#include "daemon/service/status_json.h"
#include "daemon/session/durable_file.h"
#include "daemon/session/plan_json.h"
#include "daemon/session/reduction.h"
#include "drivers/backends.h"
#include "sim/open_devices.h"

namespace lightrig {
namespace {

using namespace std::chrono_literals;

constexpr auto computing_promise = 5min;  ///< between two things that a computation gets done
constexpr auto step_promise = 120s;       ///< storing a frame, asking a device, retries
constexpr std::chrono::seconds longest_space_wait = 10min;  ///< between tries on a full disk
constexpr std::uintmax_t freed_bytes = 1 << 20;             ///< more than before: worth a try
constexpr int truth_phi = 180;  ///< φd values the truth is averaged over: MERL's own

}  // namespace

// The longest that a healthy session may be silent: the longest move, exposure or homing there is.
std::chrono::milliseconds Service::longest_step() const {
  const Rig& rig = settings_.rig;
  const GantryModel& model = rig.gantry.model;
  GantryPosition least, most;
  least.axes.resize(static_cast<Eigen::Index>(model.axes.size()));
  most.axes = least.axes;
  for (std::size_t i = 0; i < model.axes.size(); ++i) {
    least.axes[static_cast<Eigen::Index>(i)] = model.axes[i].min;
    most.axes[static_cast<Eigen::Index>(i)] = model.axes[i].max;
  }
  const double seconds = move_time(model, least, most) * rig.gantry.move_time_factor +
                         model.settle_time + rig.lamp.warm_up + rig.camera.sensor.max_exposure +
                         rig.camera.readout_time;
  return std::chrono::milliseconds(std::llround(seconds * 1e3)) + rig.gantry.move_time_margin +
         rig.gantry.homing_timeout + step_promise;
}

// A plan or a reduction is alive as long as it gets something done.
Patience Service::computing(const SessionControl& control) {
  liveness_.promise(computing_promise);
  return {control.stop_token(), [this] { liveness_.promise(computing_promise); }};
}

// Where the truth is known because the laboratory is simulated, every session states its true
// error: the truth is written once as a MERL file and named as the reference.
Result<void> Service::add_truth(SessionSpec& spec) {
  if (!settings_.simulate || !spec.reference.empty()) return {};
  const auto truth = sim::truth_of(settings_.rig);
  if (!truth) return tl::unexpected(with_context("the simulator's truth", truth.error()));
  const BrdfTable table = tabulate(*truth, BivariateGrid{}, truth_phi);
  const std::vector<std::byte> bytes = encode_merl(to_merl(table, 1));
  const std::filesystem::path path = settings_.rig.session_root / ".simulated-truth.binary";
  if (auto written = write_durably(path, bytes); !written)
    return tl::unexpected(with_context("write the simulator's truth", written.error()));
  spec.reference = path;
  return {};
}

// A session that cannot be begun leaves the rig as it was: armed, nothing moved. One that waits and
// cannot go on waits on.
Result<std::string> Service::refuse_session(const Error& error) {
  if (!apply(Event::refused, error.message, {"refused", ""}))
    apply(Event::pause, error.message, {"refused", "condition"});
  return tl::unexpected(error);
}

Result<std::string> Service::do_session(SessionControl& control, const std::string& id,
                                        StartRequest request) {
  const Patience patience = computing(control);
  if (auto dark = darken(); !dark) return tl::unexpected(dark.error());
  const Rig& rig = settings_.rig;
  if (auto truth = add_truth(request.spec); !truth) return refuse_session(truth.error());
  const std::stop_token stop = control.stop_token();
  auto prepared = request.plan ? prepare_with_plan(rig, request.spec, *request.plan, patience)
                               : prepare(rig, request.spec, false, patience);
  if (!prepared && stop.stop_requested()) return not_begun(control, "plan session " + id);
  if (!prepared) return refuse_session(with_context("plan session " + id, prepared.error()));
  if (request.plan) {
    if (auto same = check_made_for(*request.plan, *prepared); !same) {
      return refuse_session(same.error());
    }
  }
  for (const std::string& remark : prepared->remarks)
    log_.debug("remark", {{"session", id}, {"text", remark}});
  if (control.stop_token().stop_requested()) return not_begun(control, "plan session " + id);
  // Here it is known what opening the rig opens; a plan made elsewhere could only tell by the file.
  prepared->plan.left_out.drivers_not_opened = drivers_not_opened(rig, settings_.simulate);
  auto folder = create_session(rig, request.spec, *prepared, id);
  if (!folder) return refuse_session(folder.error());
  log_.info("planned",
            {{"session", id},
             {"lights", std::to_string(prepared->plan.shots.size())},
             {"predicted_s", fmt::format("{:.0f}", prepared->plan.predicted_capture_time)},
             {"folder", folder->root.string()}});
  return run_session(control, *folder, request.spec, *prepared);
}

Result<std::string> Service::do_resume(SessionControl& control, const std::filesystem::path& root) {
  const Patience patience = computing(control);
  if (auto dark = darken(); !dark) return tl::unexpected(dark.error());
  auto record = read_session_folder(root);
  if (!record) return refuse_session(with_context("resume", record.error()));
  if (record->rig.text != settings_.rig.text)
    return refuse_session({ErrorCode::refused,
                           fmt::format("resume: session {} was captured with another rig file than "
                                       "{}; start the service with the session's own rig.toml",
                                       root.filename().string(), settings_.rig.path.string())});
  if (record->state == "done") return finish_resumed(control, *record);
  auto prepared = prepare_with_plan(settings_.rig, record->spec, record->plan, patience);
  if (!prepared && control.stop_token().stop_requested()) return not_begun(control, "resume");
  if (!prepared) return refuse_session(with_context("resume", prepared.error()));
  log_.info("resuming", {{"session", root.filename().string()},
                         {"captured", std::to_string(record->shots.size())},
                         {"of", std::to_string(record->plan.shots.size())}});
  return run_session(control, record->folder, record->spec, *prepared);
}

// A session whose capture has ended: what a kill took from its result or its seal is made up for.
Result<std::string> Service::finish_resumed(SessionControl& control, const SessionRecord& record) {
  {
    const std::lock_guard lock(mutex_);
    session_->folder = record.folder.root;
    session_->progress.shots_done = static_cast<int>(record.shots.size());
    session_->progress.shots_total = static_cast<int>(record.plan.shots.size());
  }
  tell_from_the_beginning(record.folder);
  log_.info("resuming", {{"session", record.folder.root.filename().string()},
                         {"at", "its reduction: everything is captured"}});
  if (control.stop_token().stop_requested() || !apply(Event::captured))
    return not_begun(control, "resume");
  return reduce(control, record.folder);
}

// A reader of a session that goes on is told all of it.
void Service::tell_from_the_beginning(const SessionFolder& folder) {
  const std::string id = folder.root.filename().string();
  hub_.begin_session(id);
  if (auto before = replay_journal(folder.journal()))
    for (const JournalEvent& event : before->events)
      hub_.publish(event.sequence, event.event, event_json(id, event));
}

Result<std::string> Service::run_session(SessionControl& control, const SessionFolder& folder,
                                         const SessionSpec& spec, Prepared& prepared) {
  {
    const std::lock_guard lock(mutex_);
    session_->folder = folder.root;
    session_->progress.shots_total = static_cast<int>(prepared.plan.shots.size());
  }
  tell_from_the_beginning(folder);
  // A session given back to wait was set to go on when it was resumed.
  const bool may_begin = snapshot().state == State::capturing
                             ? !control.stop_token().stop_requested()
                             : apply_unless_stopped(Event::planned, control);
  if (!may_begin) return not_begun(control, "begin the capture");
  // A simulated camera looks at the session's own object; real devices are open since arming.
  if (access_.simulated() || !access_.is_open()) {
    auto opened = access_.open(spec.object, control.stop_token());
    if (!opened) {
      if (control.stop_token().stop_requested()) return not_begun(control, "open the rig");
      apply(Event::fault, opened.error().message);
      return tl::unexpected(opened.error());
    }
    remember(*opened);
  }
  access_.set_object(spec.object);
  object_ = spec.object;
  liveness_.promise(longest_step());
  bool ended = false;
  const SessionListeners listeners{
      [this](const JournalEvent& event) { on_event(event); },
      [this](const SessionProgress& progress) { on_progress(progress); },
      [this](const Frame& frame, const std::string& shot) { on_frame(frame, shot); },
      [this](const std::string&, std::uint64_t take) { access_.set_take(take); },
      [this, &control, &ended](const SessionEnd& how) {
        ended = true;
        end_capture(control, how);
      }};
  SessionEnd end;
  // From its first line on capture() waits for space itself.
  const auto begun =
      while_there_is_space(control, folder.root, Event::resume, [&]() -> Result<void> {
        liveness_.promise(longest_step());
        end =
            capture(folder, settings_.rig, spec, prepared, access_.devices(), access_.clock(),
                    control, listeners,
                    [this](Reopen what, std::unique_ptr<Camera> old, const std::stop_token& stop) {
                      return access_.reopen(what, std::move(old), stop);
                    });
        if (end.waits_for_space && !end.lamp_may_be_on)
          return fail(ErrorCode::no_space, end.reason);
        return {};
      });
  if (!begun) return not_begun(control, "begin the capture");
  if (!ended) end_capture(control, end);  // it had not got as far as its first line
  return finish_session(control, folder, end);
}

// Unless the session goes on, its devices are given back now, and not once the light in hand is
// reduced.
void Service::end_capture(const SessionControl& control, const SessionEnd& end) {
  access_.remember_lamp(!end.lamp_may_be_on);
  lamp_unsure(end.lamp_may_be_on);
  if (end.lamp_may_be_on || end.outcome == SessionOutcome::faulted)
    apply(Event::fault, end.reason);
  else if (end.outcome == SessionOutcome::aborted)
    apply(Event::abort, control.reason().empty() ? end.reason : control.reason());
  settle_devices();
}

Result<std::string> Service::finish_session(SessionControl& control, const SessionFolder& folder,
                                            const SessionEnd& end) {
  switch (end.outcome) {
    case SessionOutcome::done:
    case SessionOutcome::stopped_early:
      break;
    case SessionOutcome::paused:
      if (control.halted())
        apply(Event::halted, end.reason, {"", "person"});
      else
        apply(Event::pause, end.reason, {"", "condition"});
      return end.reason;
    case SessionOutcome::aborted:
      return fail(ErrorCode::stopped, end.reason);
    case SessionOutcome::faulted:
      return fail(ErrorCode::refused, end.reason);
  }
  if (auto facts = access_.facts(control.stop_token())) remember(*facts);
  liveness_.promise(computing_promise);
  apply(Event::captured, end.reason);
  return reduce(control, folder);
}

// A step to the disk, done again each time that its disk has space again.
Result<void> Service::while_there_is_space(SessionControl& control,
                                           const std::filesystem::path& folder, Event goes_on,
                                           const std::function<Result<void>()>& step) {
  for (std::chrono::seconds longest = 2s;; longest = std::min(2 * longest, longest_space_wait)) {
    liveness_.promise(computing_promise);
    const auto done = step();
    if (done || done.error().code != ErrorCode::no_space) return done;
    const bool waits =
        apply(Event::pause,
              done.error().message + "; free some space there: the session then goes on by itself",
              {"", "no_space"});
    if (!waits) return done;  // aborted or faulted: nobody waits for it
    if (auto waited = wait_for_space(control, folder, longest); !waited) return waited;
    if (!apply(goes_on)) return fail(ErrorCode::stopped, control.reason());
  }
}

// Until somebody has freed some, says so, or it is time to try again: a quota is not seen from
// here.
Result<void> Service::wait_for_space(SessionControl& control, const std::filesystem::path& folder,
                                     std::chrono::seconds longest) {
  const auto available = [&folder] {
    std::error_code error;
    const auto space = std::filesystem::space(folder, error);
    return error ? 0 : space.available;
  };
  const std::uintmax_t then = available();
  const auto end = SteadyClock::now() + longest;
  control.forget_word();
  while (SteadyClock::now() < end && available() < then + freed_bytes) {
    liveness_.promise(step_promise);
    const bool word = control.wait_for_word(250ms);
    if (control.halted()) apply(Event::halted, control.reason(), {"", "person"});
    if (control.stop_token().stop_requested()) return fail(ErrorCode::stopped, control.reason());
    if (word) break;
  }
  return {};
}

Result<std::string> Service::reduce(SessionControl& control, const SessionFolder& folder) {
  const std::string id = folder.root.filename().string();
  Result<ReductionSummary> summary = ReductionSummary{};
  const Patience patience = computing(control);
  const auto reduced =
      while_there_is_space(control, folder.root, Event::captured, [&]() -> Result<void> {
        summary = reduce_session(folder.root, folder.root, settings_.threads, {}, patience,
                                 [this](const CurvePoint& point) {
                                   on_points({&point, 1});
                                 });
        return summary ? Result<void>() : tl::unexpected(summary.error());
      });
  if (!reduced) {
    const std::string reason =
        fmt::format("no result: {}; the frames are stored, lightrig resume {} reduces and seals it",
                    reduced.error().message, id);
    if (!apply(Event::refused, reason, {"captured", ""})) {
      // Aborted, halted or faulted meanwhile: that stays, and so does why.
      const std::lock_guard lock(mutex_);
      session_->reason += (session_->reason.empty() ? "" : "; ") + reason;
    }
    return tl::unexpected(with_context("reduce the session", reduced.error()));
  }
  const auto sealed = while_there_is_space(control, folder.root, Event::captured,
                                           [&] { return seal_session(folder, patience); });
  if (!sealed && control.stop_token().stop_requested())
    return tl::unexpected(with_context("seal the session", sealed.error()));
  if (!sealed) log_.warning("not_sealed", {{"session", id}, {"reason", sealed.error().message}});
  const auto percent = [](double value) { return fmt::format("{:.2f}", value); };
  const double predicted =
      summary->curve.empty() ? 0 : summary->curve.back().predicted_error_percent;
  {
    const std::lock_guard lock(mutex_);
    ++sessions_done_;
    session_->curve = summary->curve;
    if (!summary->curve.empty()) session_->progress.predicted_error_percent = predicted;
    if (summary->has_truth) session_->progress.true_error_percent = summary->true_error.percent_log;
    session_->progress.activity = "done";
    session_->progress.remaining_s = 0;
    session_->result = summary->result;
  }
  apply(Event::reduced);
  log_.info("result", {{"session", folder.root.filename().string()},
                       {"predicted_error_percent", percent(predicted)},
                       {"true_error_percent",
                        summary->has_truth ? percent(summary->true_error.percent_log) : "unknown"},
                       {"folder", summary->result.string()}});
  return "the session is done; its result is in " + summary->result.string();
}

}  // namespace lightrig
