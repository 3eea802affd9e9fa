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
  if (auto done = take_ambient(shot); !done) return failed(done.error());
  say("warming the lamp for " + name_of_shot(index));
  if (auto on = hand_.lamp_on(); !on) return failed(on.error());
  const auto exposures = meter(shot);
  if (!exposures) return failed(exposures.error());
  const std::string folder = name_of_shot(index);
  for (std::size_t i = 0; i < exposures->size(); ++i) {
    if (auto go = checkpoint(plan.gantry); !go) return failed(go.error());
    say(fmt::format("exposing {} {}/{}", folder, i + 1, exposures->size()));
    auto frame = take(folder, exposure_name((*exposures)[i]), "bracket", (*exposures)[i]);
    if (!frame) return failed(frame.error());
    if (auto stood = still_in_place(plan.gantry); !stood) return failed(stood.error());
    store_.add(std::move(*frame));
  }
  // A lamp that failed on the way would make dark frames of lit ones.
  if (auto lit = hand_.still_lit(); !lit) return failed(lit.error());
  if (auto dark = hand_.lamp_dark(); !dark) return failed(dark.error());
  const auto after = hand_.status();
  if (!after) return failed(after.error());
  if (const std::string reason = not_in_place(t_.rig.gantry.model, *after, plan.gantry);
      !reason.empty()) {
    return fail(ErrorCode::refused, "verify the position after the bracket: " + reason +
                                        "; its frames were thrown away");
  }
  shot.stood_at = after->position;
  shot.finished_at = utc_now();
  return shot;
}

/// One lamp-off frame: at the longest exposure on offer that the ambient light does not saturate.
Result<void> CaptureRun::take_ambient(const TakenShot& shot) {
  const std::string folder = name_of_shot(shot.index);
  std::vector<double> offered = planned(shot.index).exposures;
  while (true) {
    if (auto go = checkpoint(planned(shot.index).gantry); !go) return go;
    say("ambient frame of " + folder);
    auto frame = take(folder, "ambient", "ambient", offered.back());
    if (!frame) return tl::unexpected(frame.error());
    if (auto stood = still_in_place(planned(shot.index).gantry); !stood)
      return tl::unexpected(stood.error());
    offered.pop_back();
    if (!offered.empty() && too_long(frame->frame, t_.rig.camera.sensor)) continue;
    store_.add(std::move(*frame));
    return {};
  }
}

/// The exposures still to take: all, or those that the metering frame shows to be needed. The
/// metering frame is data too and is not taken twice.
Result<std::vector<double>> CaptureRun::meter(TakenShot& shot) {
  const Shot& plan = planned(shot.index);
  if (!t_.spec.bracket.metering) return plan.exposures;
  if (auto go = checkpoint(plan.gantry); !go) return tl::unexpected(go.error());
  const std::string folder = name_of_shot(shot.index);
  const double exposure = metering_exposure(plan.exposures);
  say("metering " + folder);
  auto frame = take(folder, "metering", "metering", exposure);
  if (!frame) return tl::unexpected(frame.error());
  if (auto stood = still_in_place(plan.gantry); !stood) return tl::unexpected(stood.error());
  const ExposureChoice choice =
      choose_exposures(frame->frame, lit_sites(t_.rig, t_.spec, t_.prepared, shot.index),
                       plan.exposures, t_.rig.camera.sensor, t_.spec.bracket.target_snr);
  store_.add(std::move(*frame));
  shot.skipped = choice.skipped;
  std::vector<double> remaining = choice.exposures;
  std::erase(remaining, exposure);
  return remaining;
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
