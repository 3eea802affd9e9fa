// What a capture is held up by, beside people, interlocks and the disk: lost packets, a hot lamp or
// camera, a lamp that no longer shines as it did.
#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <cmath>

#include "daemon/session/capture_run.h"
#include "daemon/session/frame_file.h"
#include "daemon/session/pause_rules.h"

namespace lightrig {
namespace {

constexpr int doubts_before_pause = 2;

/// Sites whose median must be measured for a change of this share to stand out by four standard
/// errors: each is at least ten sigma above its noise, and a median's error is 1.25 σ / √n.
int enough_sites(double share) { return static_cast<int>(std::ceil(std::pow(0.5 / share, 2))); }

tl::unexpected<Error> no_sensor(const char* table, const char* whose) {
  return fail(ErrorCode::invalid_input,
              fmt::format("[pause.{}]: the {} reports no temperature; name its sensor in the rig "
                          "file, or remove that table",
                          table, whose));
}

std::string bounds(const PauseRule& rule, const std::string& upper, const std::string& lower) {
  return rule.resume_by_itself
             ? fmt::format("above the {} allowed; goes on by itself at {} or less", upper, lower)
             : fmt::format("above the {} allowed; mend it and resume", upper);
}

}  // namespace

/// Between two lights, lamp dark: pauses for whatever the rig file has watched.
Result<void> CaptureRun::watch_conditions() {
  if (auto held = pause_for_packets(); !held) return tl::unexpected(held.error());
  if (auto held = pause_for_heat(); !held) return held;
  const auto& drift = t_.rig.pause.lamp_drift;
  if (drift && lights_since_look_ >= drift->every_lights) return watch_lamp();
  return {};
}

/// Pauses while a reading is out of its bounds; whether it did. `tell` puts a reading into words,
/// `look` reads it again: empty when there is nothing new yet (told whether a person gave a word).
template <class Tell, class Look>
Result<bool> CaptureRun::hold(const PauseRule& rule, double reading, Tell tell, Look look) {
  if (next(Hold::none, rule, reading) == Hold::none) return false;
  std::string reason = tell(reading);
  const auto paused = pause("condition", reason, [&](bool word) -> Result<bool> {
    if (t_.control.stop_after_shot_requested()) return true;
    const Result<std::optional<double>> seen = look(word);
    if (!seen) return tl::unexpected(seen.error());
    if (*seen) reading = **seen;
    reason = tell(reading);
    return may_go_on(rule, reading, word);
  });
  if (!paused) return tl::unexpected(paused.error());
  return true;
}

/// Frames in the dark show whether packets still go astray.
Result<bool> CaptureRun::pause_for_packets() {
  const auto& packets = t_.rig.pause.packet_loss;
  if (!packets) return false;
  const double reading = hand_.packets().per_frame();
  if (next(Hold::none, packets->rule, reading) == Hold::held) hand_.packets().forget();
  return hold(
      packets->rule, reading,
      [&](double now) {
        return fmt::format(
            "the camera lost or repeated {:.1f} packets a frame, {}; look at cable, switch, packet "
            "size and socket buffer",
            now,
            bounds(packets->rule, fmt::format("{:g}", packets->rule.pause_above),
                   fmt::format("{:g} over {} frames", packets->rule.resume_below,
                               packets->over_frames)));
      },
      [this](bool) -> Result<std::optional<double>> {
        if (auto looked = dark_look(); !looked) return tl::unexpected(looked.error());
        if (!hand_.packets().full()) return std::optional<double>();
        return std::optional(hand_.packets().per_frame());
      });
}

/// A frame that nobody keeps: the camera's counters and temperature are what it is taken for.
Result<void> CaptureRun::dark_look() {
  const auto frame = hand_.expose(t_.spec.bracket.exposures.front());
  if (!frame && frame.error().code != ErrorCode::timed_out) return tl::unexpected(frame.error());
  return {};
}

Result<void> CaptureRun::pause_for_heat() {
  const auto of_lamp = [this](bool) -> Result<std::optional<double>> {
    auto state = persevere("ask the lamp's temperature", [this] { return hand_.lamp_state(); });
    if (!state) return tl::unexpected(state.error());
    if (!state->temperature_c) return no_sensor("lamp_temperature", "lamp");
    return state->temperature_c;
  };
  bool paused = false;
  const auto of_camera = [this, &paused](bool) -> Result<std::optional<double>> {
    // The camera says it with a frame.
    if (paused) {
      if (auto looked = dark_look(); !looked) return tl::unexpected(looked.error());
    }
    paused = true;
    const auto now = hand_.camera_temperature();
    if (!now) return no_sensor("camera_temperature", "camera");
    return now;
  };
  const auto watch = [this](const std::optional<PauseRule>& rule, const char* whose,
                            auto look) -> Result<void> {
    if (!rule) return {};
    const Result<std::optional<double>> now = look(false);
    if (!now) return tl::unexpected(now.error());
    const auto held = hold(
        *rule, **now,
        [&](double hot) {
          return fmt::format("the {} is at {:.1f} °C, {}", whose, hot,
                             bounds(*rule, fmt::format("{:g} °C", rule->pause_above),
                                    fmt::format("{:g} °C", rule->resume_below)));
        },
        look);
    if (!held) return tl::unexpected(held.error());
    return {};
  };
  if (auto watched = watch(t_.rig.pause.lamp_temperature, "lamp", of_lamp); !watched)
    return watched;
  return watch(t_.rig.pause.camera_temperature, "camera", of_camera);
}

/// Pauses once pictures have contradicted the lamp a second time in a row; whether it did. Only a
/// person can say that it is mended.
Result<bool> CaptureRun::pause_for_lamp() {
  if (lamp_doubts_ < doubts_before_pause) return false;
  lamp_doubts_ = 0;
  const auto paused = pause(
      "condition",
      lamp_doubt_ +
          "; twice in a row: the lamp has possibly failed, though it says it "
          "did as told. Look at the lamp and its supply, and resume: the "
          "shot is then taken anew",
      [this](bool word) -> Result<bool> { return word || t_.control.stop_after_shot_requested(); });
  if (!paused) return tl::unexpected(paused.error());
  return true;
}

/// The frame of the first light captured that shows the most sites well.
Result<StoredFrame> CaptureRun::drift_reference() {
  if (drift_reference_) return *drift_reference_;
  const CapturedShot& shot = captured_.shots.front();
  const auto sites = lit_sites(t_.rig, t_.spec, t_.prepared, shot.index);
  int most = 0;
  std::optional<StoredFrame> best;
  for (const StoredFrame& stored : shot.frames) {
    if (stored.role == "ambient") continue;
    const auto frame = read_frame(t_.folder.root / stored.file);
    if (!frame) return tl::unexpected(frame.error());
    const int shown = compare_frames(*frame, *frame, sites, t_.rig.camera.sensor).sites;
    if (shown > most) best = stored;
    most = std::max(most, shown);
  }
  const double share = t_.rig.pause.lamp_drift->rule.pause_above;
  if (most < enough_sites(share))
    return fail(ErrorCode::invalid_input,
                fmt::format("[pause.lamp_drift]: {} shows {} sites well enough to measure the lamp "
                            "by, {} are needed for a change of {:g} % to stand out; add exposures, "
                            "or raise pause_above_percent",
                            shot.name, most, enough_sites(share), 100 * share));
  drift_reference_ = *best;
  return *best;
}

/// Takes a frame of the first light again and pauses while the lamp does not shine as it did then.
Result<void> CaptureRun::watch_lamp() {
  if (auto collected = collect_shot(); !collected) return collected;
  const auto& drift = t_.rig.pause.lamp_drift;
  if (!drift || captured_.shots.empty() || lights_since_look_ == 0) return {};
  const CapturedShot shot = captured_.shots.front();
  const auto stored = drift_reference();
  if (!stored) return tl::unexpected(stored.error());
  double ratio = 1;
  const auto look = [&]() -> Result<double> {
    say("looking at the lamp by " + shot.name);
    auto like = persevere("reference frame", [&] { return reference_likeness(shot, *stored); });
    if (!like) return tl::unexpected(like.error());
    ratio = like->ratio;
    const double off = std::abs(ratio - 1);
    auto noted = note_reference(shot.name, off <= drift->rule.pause_above, *like);
    if (!noted) return tl::unexpected(noted.error());
    return off;
  };
  const auto first = look();
  if (!first) return tl::unexpected(first.error());
  const auto since =
      std::min<std::size_t>(static_cast<std::size_t>(lights_since_look_), captured_.shots.size());
  std::string doubtful;
  for (auto it = captured_.shots.end() - static_cast<std::ptrdiff_t>(since);
       it != captured_.shots.end(); ++it)
    doubtful += " " + it->name;
  lights_since_look_ = 0;
  auto looked = std::chrono::steady_clock::now();
  const auto held = hold(
      drift->rule, *first,
      [&](double off) {
        return fmt::format(
            "the lamp gives {:.1f} % of the light it gave for {}, {:.1f} % off, {}; captured since "
            "the look before:{} (lightrig retake, if it matters)",
            100 * ratio, shot.name, 100 * off,
            bounds(drift->rule, fmt::format("{:g} %", 100 * drift->rule.pause_above),
                   fmt::format("{:g} %", 100 * drift->rule.resume_below)),
            doubtful);
      },
      [&](bool word) -> Result<std::optional<double>> {
        const auto time = std::chrono::steady_clock::now();
        const bool due = drift->rule.resume_by_itself &&
                         std::chrono::duration<double>(time - looked).count() >= drift->recheck;
        if (!word && !due) return std::optional<double>();
        const auto again = look();
        looked = std::chrono::steady_clock::now();
        if (!again) return tl::unexpected(again.error());
        return std::optional(*again);
      });
  if (!held) return tl::unexpected(held.error());
  return {};
}

}  // namespace lightrig
