// What capture() and the reduction tell on their way, on the session thread.
#include <algorithm>
#include <span>
#include <string>

#include "config/json_text.h"
#include "daemon/service/service.h"
#include "daemon/service/status_json.h"

namespace lightrig {

void Service::on_event(const JournalEvent& event) {
  liveness_.promise(longest_step());
  std::string session;
  {
    const std::lock_guard lock(mutex_);
    session = session_->id;
    if (event.event == "resumed")
      session_->pause_requested = active_ != nullptr && active_->pause_requested();
  }
  hub_.publish(event.sequence, event.event, event_json(session, event));
  const auto word = [&](const char* name) {
    return event.fields.is_object() && event.fields.contains(name) && event.fields[name].is_string()
               ? event.fields[name].get<std::string>()
               : std::string();
  };
  if (event.event == "paused") apply(Event::pause, word("reason"), {"", word("why")});
  if (event.event == "resumed") apply(Event::resume);
  // Nobody waits for a wrong pose unless the rig file says so: somebody should still read of it.
  const bool doubtful = event.event == "pose" && !word("reason").empty();
  log_.write(doubtful ? LogLevel::warning : LogLevel::info, event.event,
             {{"session", session},
              {"seq", std::to_string(event.sequence)},
              {"shot", word("name")},
              {"outcome", word("outcome")},
              {"reason", word("reason")}});
  log_.debug("journal", {{"seq", std::to_string(event.sequence)},
                         {"facts", event.fields.is_null() ? "" : json_text(event.fields)}});
}

void Service::on_progress(const SessionProgress& progress) {
  liveness_.promise(longest_step());
  std::string session;
  SessionProgress told = progress;
  std::optional<RigFacts> facts;
  {
    const std::lock_guard lock(mutex_);
    session = session_->id;
    // Resumed, it has reduced nothing yet; what was known before still holds.
    if (const std::vector<CurvePoint>& curve = session_->curve;
        progress.curve.empty() && progress.shots_done > 0 && !curve.empty()) {
      told.predicted_error_percent = curve.back().predicted_error_percent;
      told.held_out_error_percent = curve.back().held_out_error_percent;
      told.true_error_percent = curve.back().true_error_percent;
    }
    if (facts_ && progress.gantry) facts_->gantry = *progress.gantry;
    if (facts_ && facts_->lamp && progress.lamp_power) facts_->lamp->power = *progress.lamp_power;
    facts = facts_;
    session_->progress = told;
    session_->progress.curve.clear();
    settle_steering();
  }
  hub_.update("progress", progress_json(session, told, facts));
  on_points(progress.curve);
}

// The curve grows as lights are reduced: also by those of before a restart, which are again.
void Service::on_points(std::span<const CurvePoint> points) {
  bool news = false;
  {
    const std::lock_guard lock(mutex_);
    std::vector<CurvePoint>& curve = session_->curve;
    // A light taken back takes its point along.
    news = std::erase_if(curve, [&](const CurvePoint& point) {
             return point.lights > session_->progress.shots_done;
           }) > 0;
    for (const CurvePoint& point : points) {
      auto at = std::ranges::lower_bound(curve, point.lights, {}, &CurvePoint::lights);
      if (at != curve.end() && *at == point) continue;
      if (at == curve.end() || at->lights != point.lights) at = curve.insert(at, point);
      *at = point;
      news = true;
    }
  }
  if (news) tell_state();
}

void Service::on_frame(const Frame& frame, const std::string& shot) {
  liveness_.promise(longest_step());
  {
    const std::lock_guard lock(mutex_);
    ++frames_;
  }
  hub_.update("preview", preview_json(preview_.offer(frame, shot)));
}

}  // namespace lightrig
