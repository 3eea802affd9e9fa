#include "daemon/session/capture_run.h"

#include <fmt/format.h>

#include <algorithm>
#include <set>
#include <system_error>
#include <utility>

#include "daemon/session/durable_file.h"
#include "daemon/session/frame_file.h"
#include "daemon/session/lay_candidates.h"
#include "daemon/session/lit_sites.h"

namespace lightrig {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

/// A reference frame may differ this much from the one it is compared with before a person is
/// asked: lamps drift by a few per cent over a night, and a sample that was touched moves edges.
constexpr double reference_ratio = 0.05;
constexpr double reference_strayed = 0.05;

Json frames_json(const std::vector<StoredFrame>& frames, bool with_role) {
  Json list = Json::array();
  for (const StoredFrame& frame : frames) {
    Json json{{"file", frame.file}};
    if (with_role) json["role"] = frame.role;
    json["exposure_s"] = frame.exposure;
    json["sha256"] = frame.sha256;
    list.push_back(std::move(json));
  }
  return list;
}

std::vector<double> axes_list(const GantryPosition& position) {
  return {position.axes.data(), position.axes.data() + position.axes.size()};
}

}  // namespace

CaptureRun::CaptureRun(const CaptureTools& tools, Journal journal, Captured captured)
    : t_(tools),
      journal_(std::move(journal)),
      captured_(std::move(captured)),
      hand_(tools.rig, tools.prepared, tools.devices, tools.clock, tools.control.stop_token()),
      store_(tools.folder, tools.rig.camera.sensor),
      alongside_(tools.rig, tools.spec, tools.prepared, tools.folder),
      predicted_(
          capture_time(tools.rig, tools.spec, tools.prepared.plan, &tools.prepared.object.mesh)),
      decided_(captured_.shots.size() < 2 ? 0 : captured_.shots.size() - 2),
      began_(tools.clock.now()),
      elapsed_before_(captured_.elapsed_s),
      pose_(pose_standing(journal_.replayed())) {}

SessionEnd CaptureRun::run() {
  const auto begun = begin();
  return finish(begun ? story() : Result<Ending>(tl::unexpected(begun.error())));
}

/// Notes the start, and sets aside what an interrupted part left behind: frames count only when the
/// journal says so.
Result<void> CaptureRun::begin() {
  std::set<fs::path> vouched_for;
  const auto vouch = [&](const StoredFrame& frame) {
    const fs::path file(frame.file);
    vouched_for.insert(file);
    vouched_for.insert(fs::path(file).replace_extension(".json"));
  };
  for (const StoredFrame& frame : captured_.darks) vouch(frame);
  for (const CapturedShot& shot : captured_.shots) {
    for (const StoredFrame& frame : shot.frames) vouch(frame);
  }
  const auto lost = set_aside_frames(t_.folder, vouched_for, journal_.next_sequence());
  if (!lost) return tl::unexpected(lost.error());
  if (!lost->empty()) {
    if (auto noted = note("rejected", {{"files", *lost}}); !noted) return noted;
  }
  return note("started", {{"resumed", !captured_.darks.empty() || !captured_.shots.empty()},
                          {"torn_tail_cut", journal_.torn_tail()},
                          {"measured",
                           {{"at", utc_now()},
                            {"elapsed_s", elapsed()},
                            {"camera", t_.devices.camera ? t_.devices.camera->identity() : ""}}}});
}

Result<Ending> CaptureRun::story() {
  const bool resumed = !captured_.shots.empty();
  if (auto done = home(); !done) return tl::unexpected(done.error());
  if (auto done = ensure_darks(); !done) return tl::unexpected(done.error());
  alongside_.start(captured_.darks, !pose_.looked);
  for (const CapturedShot& shot : captured_.shots) alongside_.add(shot);
  if (resumed && next_light()) {
    auto differs = compare_reference();
    if (!differs) return tl::unexpected(differs.error());
    if (*differs) return **differs;
  }
  while (true) {
    if (auto looked = replan_after_losses(); !looked) return tl::unexpected(looked.error());
    const std::optional<int> next = next_light();
    if (!next) break;
    if (auto fine = watch_conditions(); !fine) return tl::unexpected(fine.error());
    auto ending = capture_next(*next);
    if (!ending) return tl::unexpected(ending.error());
    if (*ending) return **ending;
  }
  if (auto collected = collect_shot(); !collected) return tl::unexpected(collected.error());
  if (auto looked = look_at_pose(false); !looked) return tl::unexpected(looked.error());
  if (auto fine = watch_lamp(); !fine) return tl::unexpected(fine.error());
  return Ending{SessionOutcome::done, fmt::format("all {} lights of the plan are captured",
                                                  t_.prepared.plan.shots.size())};
}

Result<void> CaptureRun::home() {
  say("homing");
  // Known dark from here on, whatever the lamp did before.
  if (auto dark = persevere("switch the lamp off", [this] { return hand_.lamp_dark(); }); !dark) {
    return dark;
  }
  auto homed = persevere("home", [this]() -> Result<void> {
    if (homed_) return {};  // recovering from a failure has homed it already
    const auto now = hand_.status();
    if (!now) return tl::unexpected(now.error());
    if (!now->alarm.empty() || !now->open_interlocks.empty()) {
      return fail(ErrorCode::refused,
                  "home the gantry: " + not_in_place(t_.rig.gantry.model, *now, now->position));
    }
    if (auto done = hand_.home(); !done) return done;
    homed_ = true;
    return {};
  });
  if (!homed) return homed;
  return note("homed", {{"measured", {{"at", utc_now()}, {"elapsed_s", elapsed()}}}});
}

/// Lamp-off frames at every exposure on offer, common to all shots.
Result<void> CaptureRun::ensure_darks() {
  const std::vector<double>& offered = t_.spec.bracket.exposures;
  if (captured_.darks.size() == offered.size()) return {};
  const GantryPosition home = home_position(t_.rig.gantry.model);
  bool first = true;
  auto taken = persevere("dark frames", [&]() -> Result<void> {
    // Like a shot, done again from its move on.
    if (!std::exchange(first, false)) {
      if (auto there = hand_.go_to(home); !there) return there;
    }
    store_.drop();
    for (std::size_t i = 0; i < offered.size(); ++i) {
      if (auto go = checkpoint(home); !go) return go;
      say(fmt::format("dark frame {}/{}", i + 1, offered.size()));
      auto frame = take("dark", exposure_name(offered[i]), "dark", offered[i]);
      if (!frame) return tl::unexpected(frame.error());
      store_.add(std::move(*frame));
    }
    return {};
  });
  if (!taken) return taken;
  store_.begin();
  auto stored = persevere("store the dark frames",
                          [this] { return store_.collect(t_.control.stop_token()); });
  if (!stored) return tl::unexpected(stored.error());
  space_waits_ = 0;
  captured_.darks = *stored;
  return note("dark", {{"frames", frames_json(captured_.darks, false)},
                       {"measured", {{"at", utc_now()}, {"elapsed_s", elapsed()}}}});
}

/// Before a resumed session goes on: is the scene still what it was? Also brings the gantry to
/// where it would have come from had nothing happened.
Result<std::optional<Ending>> CaptureRun::compare_reference() {
  const CapturedShot& shot = captured_.shots.back();
  const auto stored = std::ranges::find_if(shot.frames, [](const StoredFrame& frame) {
    return frame.role == "metering" || frame.role == "bracket";
  });
  if (stored == shot.frames.end()) return std::optional<Ending>();
  say("comparing a reference frame with " + shot.name);
  const auto likeness =
      persevere("reference frame", [&] { return reference_likeness(shot, *stored); });
  if (!likeness) return tl::unexpected(likeness.error());
  // Of no sites: dark now and then, or saturated both times. Nothing has changed that could be
  // seen.
  const bool like =
      std::abs(likeness->ratio - 1) <= reference_ratio && likeness->strayed <= reference_strayed;
  if (auto noted = note_reference(shot.name, like, *likeness); !noted)
    return tl::unexpected(noted.error());
  if (like) return std::optional<Ending>();
  return std::optional<Ending>(
      {SessionOutcome::paused,
       fmt::format(
           "the scene is not what it was: against {}, a frame taken now is {:.1f} % as "
           "bright, and {:.1f} % of {} sites have changed; put sample, camera and lamp back "
           "and resume, or begin a new session",
           shot.name, 100 * likeness->ratio, 100 * likeness->strayed, likeness->sites)});
}

Result<void> CaptureRun::note_reference(const std::string& name, bool like,
                                        const FrameLikeness& likeness) {
  return note("reference", {{"name", name},
                            {"like", like},
                            {"measured",
                             {{"ratio", likeness.ratio},
                              {"strayed", likeness.strayed},
                              {"sites", likeness.sites},
                              {"elapsed_s", elapsed()}}}});
}

Result<FrameLikeness> CaptureRun::reference_likeness(const CapturedShot& shot,
                                                     const StoredFrame& stored) {
  const auto then = read_frame(t_.folder.root / stored.file);
  if (!then) return tl::unexpected(then.error());
  if (auto there = approach(shot.index); !there) return tl::unexpected(there.error());
  if (auto on = hand_.lamp_on(); !on) return tl::unexpected(on.error());
  const auto now = hand_.expose(stored.exposure);
  if (!now) return tl::unexpected(now.error());
  if (auto dark = hand_.lamp_dark(); !dark) return tl::unexpected(dark.error());
  return compare_frames(*then, *now, lit_sites(t_.rig, t_.spec, t_.prepared, shot.index),
                        t_.rig.camera.sensor);
}

/// Moves, and meanwhile the shot before is stored; journals that one; takes this one.
Result<std::optional<Ending>> CaptureRun::capture_next(int index) {
  const std::string name = name_of_shot(index);
  if (t_.listeners.shot_begins) t_.listeners.shot_begins(name, captured_.retakes[name]);
  auto there = persevere("move to " + name, [&] { return approach(index); });
  if (!there) return tl::unexpected(there.error());
  if (auto collected = collect_shot(); !collected) return tl::unexpected(collected.error());
  if (auto looked = look_at_pose(true); !looked) return tl::unexpected(looked.error());
  if (auto ending = early_ending(index)) return ending;
  bool first = true;
  auto taken = persevere("capture " + name, [&]() -> Result<TakenShot> {
    // A shot that failed is done again from its move on, wherever the gantry may stand now.
    if (!std::exchange(first, false)) {
      if (auto again = approach(index); !again) return tl::unexpected(again.error());
    }
    return take_shot(index);
  });
  if (!taken) return tl::unexpected(taken.error());
  store_.begin();
  pending_ = std::move(*taken);
  ++lights_since_look_;
  return std::optional<Ending>();
}

/// Waits until the shot in hand is stored, and journals it.
Result<void> CaptureRun::collect_shot() {
  if (!pending_) return {};
  const std::string name = name_of_shot(pending_->index);
  if (t_.listeners.frame) {
    for (const TakenFrame& taken : store_.in_hand()) t_.listeners.frame(taken.frame, name);
  }
  auto stored =
      persevere("store " + name, [this] { return store_.collect(t_.control.stop_token()); });
  if (!stored) return tl::unexpected(stored.error());
  space_waits_ = 0;
  CapturedShot captured = describe(*stored);
  if (auto noted = note("shot", shot_fields(captured)); !noted) return noted;
  pending_.reset();
  captured_.shots.push_back(captured);
  alongside_.add(std::move(captured));
  if (const std::string problem = alongside_.take_problem(); !problem.empty()) {
    return note("reduction_failed", {{"reason", problem}});
  }
  return {};
}

/// Once a session, by the lights that it takes to decide, lamp dark and before the next shines:
/// where the object does not lie as modelled, a person says whether to go on.
Result<void> CaptureRun::look_at_pose(bool more_to_come) {
  if (captured_.shots.empty()) return {};
  // Where nobody is to be waited for, neither is the look: it goes on while lights are captured.
  const bool waits = t_.rig.pause.wrong_pose;
  if (!waits && more_to_come && !alongside_.pose_is_settled()) return {};
  if (!pose_.looked) {
    say("looking how the object lies");
    const std::string& shot = captured_.shots.back().name;
    const auto pose = alongside_.wait_for_pose(shot, patience());
    if (!pose && hand_.stop_requested()) return tl::unexpected(pose.error());
    if (pose && !pose->decided && more_to_come) return {};  // the next light may show more
    Json fields = pose ? pose_fields(pose->fit, pose->shot, waits, pose->agreed_by)
                       : Json{{"name", shot}, {"told", false}, {"reason", pose.error().message}};
    if (auto noted = note("pose", std::move(fields)); !noted) return noted;
    pose_ = {!pose || pose->fit.told,
             pose && wrong(pose->fit) ? pose_reason(pose->fit, waits) : ""};
  }
  if (!waits || pose_.held.empty() || !more_to_come) return {};
  auto paused = pause("condition", pose_.held, [this](bool word) -> Result<bool> {
    return word || t_.control.stop_after_shot_requested();
  });
  if (!paused) return paused;
  pose_.held.clear();
  return {};
}

CapturedShot CaptureRun::describe(std::vector<StoredFrame> stored) const {
  return {.name = name_of_shot(pending_->index),
          .index = pending_->index,
          .held_out = planned(pending_->index).held_out,
          .frames = std::move(stored),
          .exposures_skipped = pending_->skipped,
          .elapsed_s = elapsed(),
          .lamp_power = t_.rig.lamp.power};
}

Json CaptureRun::shot_fields(const CapturedShot& captured) const {
  return {{"name", captured.name},
          {"index", captured.index},
          {"held_out", captured.held_out},
          {"candidate", planned(captured.index).candidate},
          {"gantry_axes", axes_list(planned(captured.index).gantry)},
          {"lamp_power", captured.lamp_power},
          {"frames", frames_json(captured.frames, true)},
          {"skipped_s", captured.exposures_skipped},
          {"measured",
           {{"at", pending_->finished_at},
            {"elapsed_s", captured.elapsed_s},
            {"stood_at", axes_list(pending_->stood_at)}}}};
}

std::optional<Ending> CaptureRun::early_ending(int next) {
  const auto early = [](std::string reason) {
    return Ending{SessionOutcome::stopped_early, std::move(reason)};
  };
  const StopConfig& stop = t_.spec.stop;
  const auto fitted = std::ranges::count(captured_.shots, false, &CapturedShot::held_out);
  // Of no light there is no result: a session that ended so could never have one.
  if (t_.control.stop_after_shot_requested() && fitted == 0)
    return Ending{SessionOutcome::paused, "stopped on request, and no light is captured: resume"};
  if (t_.control.stop_after_shot_requested()) return early("stopped after a shot, on request");
  if (stop.lights && fitted >= *stop.lights) {
    return early(fmt::format("[stop] lights = {} are captured", *stop.lights));
  }
  if (std::string over = out_of_time(next, fitted > 0); !over.empty()) return early(over);
  if (stop.predicted_error_percent && fitted > 0) {
    say("estimating the error so far");
    const auto point = alongside_.wait_for_all(patience());
    if (point && point->predicted_error_percent <= *stop.predicted_error_percent) {
      return early(
          fmt::format("the predicted error {:.2f} % has reached [stop] "
                      "predicted_error_percent = {} after {} lights",
                      point->predicted_error_percent, *stop.predicted_error_percent, fitted));
    }
  }
  return std::nullopt;
}

/// The exit actions: dark first, then what is in hand is stored, then the journal says how it
/// ended.
SessionEnd CaptureRun::finish(const Result<Ending>& ending) {
  SessionEnd end;
  end.lamp_may_be_on = !end_dark();
  if (ending) {
    end.outcome = ending->outcome;
    end.reason = ending->reason;
  } else if (hand_.stop_requested()) {
    end.outcome = t_.control.halted() ? SessionOutcome::paused : SessionOutcome::aborted;
    const std::string asked = t_.control.reason();
    end.reason = asked.empty() ? "stopped on request" : asked;
  } else {
    end.outcome = SessionOutcome::faulted;
    end.reason = (activity_.empty() ? "" : activity_ + ": ") + ending.error().message;
  }
  if (const std::string lost = save_what_is_in_hand(); !lost.empty()) end.reason += "; " + lost;
  if (end.lamp_may_be_on) {
    end.reason +=
        fmt::format("; LAMP MAY BE ON ({}): switch it off at its supply", dark_problem_.message);
  }
  // The exit actions are in the journal where it can still be written; where not, its last state is
  // "capturing", which is what a crash leaves too.
  (void)try_note("lamp_dark", {{"done", !end.lamp_may_be_on}});
  (void)try_note("ended", {{"outcome", name_of(end.outcome)},
                           {"reason", end.reason},
                           {"lamp_may_be_on", end.lamp_may_be_on},
                           {"measured", {{"at", utc_now()}, {"elapsed_s", elapsed()}}}});
  say(std::string(name_of(end.outcome)));
  return end;
}

/// Whether the lamp is dark; opens its wire anew if that is what it takes.
bool CaptureRun::end_dark() {
  auto dark = hand_.lamp_dark();
  if (!dark && !hand_.lamp_known_dark() && t_.reopen) dark = hand_.reopen(t_.reopen, true);
  if (!dark) dark_problem_ = dark.error();
  return hand_.lamp_known_dark();
}

/// A shot that is taken and verified is kept also when the session ends before its journal entry.
std::string CaptureRun::save_what_is_in_hand() {
  if (!pending_) return {};
  std::string problem;
  if (const auto stored = store_.collect(std::stop_token()); !stored) {
    problem = stored.error().message;
  } else if (auto noted = try_note("shot", shot_fields(describe(*stored))); !noted) {
    problem = noted.error().message;
  }
  if (problem.empty()) return {};
  return name_of_shot(pending_->index) + " will have to be taken again: " + problem;
}

}  // namespace lightrig
