#include <fmt/format.h>

#include <algorithm>

#include "daemon/session/capture_run.h"
#include "daemon/session/plan_json.h"

namespace lightrig {

/// The next light of the way that is neither captured nor in hand.
std::optional<int> CaptureRun::next_light() const {
  for (const int index : t_.prepared.plan.visit_order) {
    const bool in_hand = pending_ && pending_->index == index;
    if (!in_hand && !is_captured(index)) return index;
  }
  return std::nullopt;
}

/// The rest of the plan in the light of what was captured: looked at before every light from the
/// third on. The light in hand was chosen before the one ahead of it was reduced, and is not
/// waited for: what a light lost tells from the light after the next on. Which shots a decision
/// rests on depends on their order alone, never on time, so that a resumed session decides alike.
Result<void> CaptureRun::replan_after_losses() {
  const std::size_t taken = captured_.shots.size() + (pending_ ? 1 : 0);
  for (; t_.spec.plan.replan && decided_ + 1 < taken; ++decided_) {
    if (auto done = replan_after(decided_); !done) return done;
  }
  return {};
}

/// What the shots of the journal up to number `last` (from 0) say of those that come after the one
/// behind it.
Result<void> CaptureRun::replan_after(std::size_t last) {
  ReplanQuestion question;
  question.yields = last + 1;
  std::vector<int> done;
  for (std::size_t i = 0; i <= last + 1 && i < captured_.shots.size(); ++i) {
    done.push_back(captured_.shots[i].index);
  }
  if (done.size() == last + 1) done.push_back(pending_->index);
  if (!planned(done.back()).held_out) question.in_hand.push_back(done.back());
  for (int i = 0; i < static_cast<int>(t_.prepared.plan.shots.size()); ++i) {
    if (std::ranges::count(done, i) > 0 || planned(i).held_out) continue;
    // A person who takes a light back wants that light again.
    const bool asked_for = captured_.retakes.contains(name_of_shot(i));
    (asked_for ? question.in_hand : question.open).push_back(i);
  }
  if (question.open.empty()) return {};
  say("looking at the rest of the plan");
  const auto answer = alongside_.replan(std::move(question), patience());
  if (!answer) {
    if (hand_.stop_requested()) return fail(ErrorCode::stopped, "stopped on request");
    return {};
  }
  Plan before = t_.prepared.plan;
  take_up(t_.rig, t_.spec, answer->changes, done, t_.prepared);
  CaptureTime time = capture_time(t_.rig, t_.spec, t_.prepared.plan, &t_.prepared.object.mesh);
  // A light that no clear way leads to would end the session: then the plan stands as it was.
  const auto shut_in = [](const ShotTime& shot) { return shot.way.empty(); };
  if (std::ranges::any_of(time.shots, shut_in)) {
    t_.prepared.plan = std::move(before);
    return {};
  }
  predicted_ = std::move(time);
  std::vector<int> lights;
  for (const auto& [index, light] : answer->changes.lights) lights.push_back(index);
  const std::string after = captured_.shots[last].name;
  nlohmann::ordered_json fields{
      {"after", after},
      {"reason", fmt::format("{}: {}", after, lightrig::describe(answer->last))},
      {"lost",
       {{"planned_bins", answer->last.planned},
        {"saturated", answer->last.saturated},
        {"dark", answer->last.dark},
        {"missing", answer->last.missing}}},
      {"predicted_error_percent",
       {{"as_planned", answer->changes.planned_percent}, {"replanned", answer->changes.percent}}}};
  fields.update(replanned_json(t_.prepared.plan, lights));
  return note("replanned", std::move(fields));
}

}  // namespace lightrig
