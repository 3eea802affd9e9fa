#include <fmt/format.h>

#include <algorithm>
#include <numeric>

#include "core/check.h"
#include "core/merge_hdr.h"
#include "daemon/session/capture_run.h"

namespace lightrig {
namespace {

/// Share of a frame that may be at white before its exposure is too long to tell the ambient light.
constexpr double ambient_white_share = 0.001;

bool too_long(const Frame& frame, const SensorModel& sensor) {
  const auto white = std::ranges::count_if(frame.counts.counts, [&](std::uint16_t count) {
    return count >= 0.97 * sensor.white_level();
  });
  return static_cast<double>(white) >
         ambient_white_share * static_cast<double>(frame.counts.counts.size());
}

}  // namespace

Result<void> CaptureRun::approach(int index) {
  const GantryPosition& target = planned(index).gantry;
  if (auto go = checkpoint(target); !go) return go;
  say("moving to " + name_of_shot(index));
  return hand_.go_to(target);
}

/// Where an exposure may wait: a pause is honoured here, and a stop. After a pause the lamp burns
/// again as it did before, and the gantry has been seen to stand where it should.
Result<void> CaptureRun::checkpoint(const GantryPosition& target) {
  if (hand_.stop_requested()) return fail(ErrorCode::stopped, "stopped on request");
  if (!t_.control.pause_requested()) return {};
  const bool lamp_was_on = hand_.lamp_known_on();
  if (auto paused = pause_for_person(); !paused) return paused;
  if (!lamp_was_on) return {};
  if (auto there = hand_.verify_at(target); !there) return there;
  return hand_.lamp_on();
}

Result<TakenShot> CaptureRun::take_shot(int index) {
  const Shot& plan = planned(index);
  const auto failed = [](const Error& error) { return tl::unexpected(error); };
  if (auto there = hand_.verify_at(plan.gantry); !there) return failed(there.error());
  store_.drop();  // what an attempt that failed has left
  TakenShot shot;
  shot.index = index;
  auto witness = take_ambient(shot);
  if (!witness) return failed(witness.error());
  say("warming the lamp for " + name_of_shot(index));
  if (auto on = hand_.lamp_on(); !on) return failed(on.error());
  const auto exposures = meter(shot, *witness);
  if (!exposures) return failed(exposures.error());
  for (std::size_t i = 0; i < exposures->size(); ++i) {
    if (auto go = checkpoint(plan.gantry); !go) return failed(go.error());
    say(fmt::format("exposing {} {}/{}", name_of_shot(index), i + 1, exposures->size()));
    auto taken =
        expose_lit(index, exposure_name((*exposures)[i]), "bracket", (*exposures)[i], *witness);
    if (!taken) return failed(taken.error());
  }
  if (auto closed = close_bracket(index, *witness); !closed) return failed(closed.error());
  if (auto dark = hand_.lamp_dark(); !dark) return failed(dark.error());
  const auto after = hand_.status();
  if (!after) return failed(after.error());
  if (const std::string reason = not_in_place(t_.rig.gantry.model, *after, plan.gantry);
      !reason.empty()) {
    return fail(ErrorCode::refused, "verify the position after the bracket: " + reason +
                                        "; its frames were thrown away");
  }
  lamp_doubts_ = 0;
  shot.stood_at = after->position;
  shot.finished_at = utc_now();
  return shot;
}

/// One lamp-off frame: at the longest exposure on offer that the ambient light does not saturate.
/// What the lit frames will be held against.
Result<LightWitness> CaptureRun::take_ambient(const TakenShot& shot) {
  const std::string folder = name_of_shot(shot.index);
  std::vector<double> offered = planned(shot.index).exposures;
  while (true) {
    if (auto go = checkpoint(planned(shot.index).gantry); !go) return tl::unexpected(go.error());
    say("ambient frame of " + folder);
    auto frame = take(folder, "ambient", "ambient", offered.back());
    if (!frame) return tl::unexpected(frame.error());
    if (auto stood = still_in_place(planned(shot.index).gantry); !stood)
      return tl::unexpected(stood.error());
    offered.pop_back();
    if (!offered.empty() && too_long(frame->frame, t_.rig.camera.sensor)) continue;
    LightWitness witness(t_.rig, t_.spec, t_.prepared, shot.index,
                         lit_sites(t_.rig, t_.spec, t_.prepared, shot.index), frame->frame);
    store_.add(std::move(*frame));
    return witness;
  }
}

/// The exposures still to take: all, or those that the metering frame shows to be needed. The
/// metering frame is data too and is not taken twice.
Result<std::vector<double>> CaptureRun::meter(TakenShot& shot, LightWitness& witness) {
  const Shot& plan = planned(shot.index);
  if (!t_.spec.bracket.metering) return plan.exposures;
  if (auto go = checkpoint(plan.gantry); !go) return tl::unexpected(go.error());
  const double exposure = metering_exposure(plan.exposures);
  say("metering " + name_of_shot(shot.index));
  auto taken = expose_lit(shot.index, "metering", "metering", exposure, witness);
  if (!taken) return tl::unexpected(taken.error());
  const ExposureChoice choice = choose_exposures(store_.last().frame, witness.lit(), plan.exposures,
                                                 t_.rig.camera.sensor, t_.spec.bracket.target_snr);
  shot.skipped = choice.skipped;
  std::erase(shot.skipped, exposure);
  std::vector<double> remaining = choice.exposures;
  std::erase(remaining, exposure);
  return remaining;
}

/// One lit frame of a shot, kept only if the gantry stood and nothing contradicts its light.
Result<void> CaptureRun::expose_lit(int index, const std::string& name, const std::string& role,
                                    double exposure, LightWitness& witness) {
  auto frame = take(name_of_shot(index), name, role, exposure);
  if (!frame) return tl::unexpected(frame.error());
  if (auto stood = still_in_place(planned(index).gantry); !stood) return stood;
  if (auto lit = believe(frame->frame, witness); !lit) return lit;
  store_.add(std::move(*frame));
  return {};
}

/// A controller repeats what its lamp was told; whether it burns only pictures say.
Result<void> CaptureRun::believe(const Frame& frame, LightWitness& witness) {
  const auto contradiction = witness.contradiction(frame);
  if (!contradiction) return {};
  ++lamp_doubts_;
  lamp_doubt_ = *contradiction;
  return fail(ErrorCode::timed_out, *contradiction + "; the shot's frames were thrown away");
}

/// That the lamp burnt to the end, by its own word and by pictures: where the last frame is too
/// dark to tell, or the only one, by one more that nobody keeps.
Result<void> CaptureRun::close_bracket(int index, LightWitness& witness) {
  const std::string name = name_of_shot(index);
  if (!witness.light_seen()) {
    const auto noted = note(
        "lamp_unseen",
        {{"name", name},
         {"reason", fmt::format("over {} lit sites no exposure shows light of the lamp beyond its "
                                "noise, nor would the darkest material have to: the pictures "
                                "cannot tell whether the lamp burnt",
                                witness.sites())}});
    if (!noted) return noted;
  } else if (const auto exposure = witness.closing_exposure()) {
    if (auto go = checkpoint(planned(index).gantry); !go) return go;
    say("looking whether the lamp burns to the end of " + name);
    const auto frame = hand_.expose(*exposure);
    if (!frame) return tl::unexpected(frame.error());
    if (auto stood = still_in_place(planned(index).gantry); !stood) return stood;
    if (auto lit = believe(*frame, witness); !lit) return lit;
  }
  return hand_.still_lit();
}

/// The position is read after every exposure, and so before the next: a frame counts only between
/// two looks that found the gantry in place.
Result<void> CaptureRun::still_in_place(const GantryPosition& target) {
  const auto after = hand_.status();
  if (!after) return tl::unexpected(after.error());
  const std::string reason = not_in_place(t_.rig.gantry.model, *after, target);
  if (reason.empty()) return {};
  return fail(ErrorCode::refused,
              "verify the position after the exposure: " + reason + "; the frame was thrown away");
}

Result<TakenFrame> CaptureRun::take(const std::string& folder, const std::string& name,
                                    const std::string& role, double exposure) {
  // After a failure it may not be known whether the lamp obeyed.
  if ((role == "dark" || role == "ambient") && !hand_.lamp_known_dark())
    if (auto dark = hand_.lamp_dark(); !dark) return tl::unexpected(dark.error());
  auto frame = hand_.expose(exposure);
  if (!frame) return tl::unexpected(frame.error());
  return TakenFrame{std::move(*frame), fmt::format("frames/{}/{}.exr", folder, name), role,
                    exposure, utc_now()};
}

/// "e1" … by place among the exposures on offer, shortest first.
std::string CaptureRun::exposure_name(double exposure) const {
  const std::vector<double>& offered = t_.spec.bracket.exposures;
  const auto place = std::ranges::find(offered, exposure);
  CHECK(place != offered.end());
  return fmt::format("e{}", std::distance(offered.begin(), place) + 1);
}

const Shot& CaptureRun::planned(int index) const {
  return t_.prepared.plan.shots[static_cast<std::size_t>(index)];
}

std::string CaptureRun::name_of_shot(int index) const { return shot_name(t_.prepared.plan, index); }

bool CaptureRun::is_captured(int index) const {
  return std::ranges::any_of(captured_.shots,
                             [index](const CapturedShot& shot) { return shot.index == index; });
}

}  // namespace lightrig
