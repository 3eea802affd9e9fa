#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <system_error>

#include "daemon/session/capture_run.h"

namespace lightrig {
namespace {

using std::chrono::milliseconds;

constexpr milliseconds interlock_calm{2000};    ///< an input must stay closed this long
constexpr milliseconds longest_backoff{30000};  ///< between tries when space seems there but is not
/// [s] before each try to open the devices again: a cable that is pulled comes back, a controller
/// restarts, a camera's privilege lapses with the heartbeat of whoever took it.
constexpr std::array reopen_pauses{0.0, 2.0, 6.0};
constexpr int most_rehomings = 1;  ///< beside the homing a session begins with
/// Beyond the frames in hand: journal lines, sidecars, and what a file system keeps for itself.
constexpr std::uintmax_t spare_bytes = 256 * 1024;

const char* name_of(Remedy remedy) {
  switch (remedy) {
    case Remedy::again:
      return "again";
    case Remedy::reopen:
      return "reopen";
    case Remedy::mend:
      return "mend";
    case Remedy::wait_for_space:
      return "wait_for_space";
    case Remedy::give_up:
      return "give_up";
  }
  return "unknown";
}

}  // namespace

/// After a failed step: lamp dark, then the remedy the policy names, until the step may be done
/// anew or is given up. A remedy that fails is a failure like any other.
Result<void> CaptureRun::recover(const std::string& step, Error error, RetryTally& tally) {
  while (true) {
    if (!hand_.lamp_known_dark()) (void)hand_.lamp_dark();
    if (hand_.stop_requested()) return fail(ErrorCode::stopped, error.message);
    if (error.code == ErrorCode::timed_out) {
      // A frame that came with holes is the network's failure, one without light the lamp's: once
      // these are well, the ladder begins anew.
      auto held = pause_for_packets();
      if (held && !*held) held = pause_for_lamp();
      if (!held && held.error().code == ErrorCode::stopped) return tl::unexpected(held.error());
      if (held && *held) tally = {};
      if (!held) error = held.error();
    }
    Remedy remedy = tally.next(error.code);
    if (remedy == Remedy::reopen && !t_.reopen) remedy = Remedy::give_up;
    if (remedy == Remedy::give_up) return tl::unexpected(error);
    const nlohmann::ordered_json retry{{"step", step},
                                       {"code", name_of(error.code)},
                                       {"reason", error.message},
                                       {"remedy", name_of(remedy)}};
    // A refusal is asked again only once its cause has been put right: until then it is no retry.
    const bool certain = remedy == Remedy::again || remedy == Remedy::reopen;
    if (certain) {
      if (auto noted = note("retry", retry); !noted) return noted;
    }
    Result<void> mended;
    if (remedy == Remedy::wait_for_space) {
      mended = wait_for_space();
    } else {
      // With the devices closed there is nothing left to be tried.
      if (remedy == Remedy::reopen)
        if (auto opened = reopen(); !opened) return opened;
      if (mended) mended = look(remedy == Remedy::mend ? std::optional(error) : std::nullopt);
    }
    if (mended && remedy == Remedy::mend) return note("retry", retry);
    if (mended) return {};
    const bool same = mended.error().message == error.message;
    error = mended.error();
    if (same && remedy == Remedy::mend) return mended;
  }
}

/// Opens the devices again, in several tries.
Result<void> CaptureRun::reopen() {
  Result<void> opened;
  double waited = 0;
  for (const double pause : reopen_pauses) {
    waited += pause;
    if (auto slept = hand_.sleep(pause); !slept) return slept;
    opened = hand_.reopen(t_.reopen);
    if (opened || opened.error().code == ErrorCode::stopped) return opened;
  }
  return fail(opened.error().code,
              fmt::format("{} (tried {} times in {:.0f} s)", opened.error().message,
                          reopen_pauses.size(), waited));
}

/// Reads the gantry's status before anything is done anew, and puts right what may be put right
/// without a person: an interlock that opened is waited for, a lost home is found again, once.
/// `unless_mended` is the error to give back when there was nothing to put right.
Result<void> CaptureRun::look(const std::optional<Error>& unless_mended) {
  bool mended = false;
  auto now = hand_.wait_for_rest();
  if (!now) return tl::unexpected(now.error());
  if (!now->open_interlocks.empty()) {
    if (auto closed = pause_for_interlocks(now->open_interlocks); !closed) return closed;
    mended = true;
    now = hand_.wait_for_rest();
    if (!now) return tl::unexpected(now.error());
  }
  if (!now->alarm.empty()) {
    return fail(ErrorCode::refused, "the gantry reports alarm " + now->alarm +
                                        "; find its cause, clear it, and resume the session");
  }
  if (!now->homed) {
    if (rehomings_ >= most_rehomings) {
      return fail(ErrorCode::refused,
                  "the gantry has lost its home position again; have the axes and their switches "
                  "looked at, then resume the session");
    }
    ++rehomings_;
    say("homing again");
    if (auto homed = hand_.home(); !homed) return homed;
    homed_ = true;
    mended = true;
  }
  if (unless_mended && !mended) return tl::unexpected(*unless_mended);
  return {};
}

Result<void> CaptureRun::pause_for_person() {
  const std::string asked = t_.control.reason();
  return pause("person", asked.empty() ? "on request" : asked,
               [this](bool) -> Result<bool> { return !t_.control.pause_requested(); });
}

Result<void> CaptureRun::pause_for_interlocks(const std::vector<std::string>& names) {
  const bool by_itself = std::ranges::all_of(names, [this](const std::string& name) {
    return std::ranges::any_of(t_.rig.interlocks, [&](const Interlock& interlock) {
      return interlock.name == name && interlock.resume_by_itself;
    });
  });
  bool told = false;
  auto last_open = std::chrono::steady_clock::now();
  const std::string reason = fmt::format("interlock open: {}; close it{}", fmt::join(names, ", "),
                                         by_itself ? "" : " and resume");
  return pause("condition", reason, [&, this](bool word) -> Result<bool> {
    // Closed, a session that is to stop after its shot takes that shot and stops.
    told = told || word || t_.control.stop_after_shot_requested();
    const auto now = hand_.status();
    if (!now) return tl::unexpected(now.error());
    const auto time = std::chrono::steady_clock::now();
    if (!now->open_interlocks.empty()) {
      last_open = time;
      told = false;  // a word given while it was open does not count once it closes
      return false;
    }
    return told || (by_itself && time - last_open >= interlock_calm);
  });
}

/// Pauses until the disk has room for the frames in hand and as many again, so that the next light
/// does not find it full at once. It goes on by itself: nobody's hand was in the way, and a night
/// should not be lost to a log that is rotated an hour later. Where room is reported and yet
/// writing fails (a quota), the waits grow longer.
Result<void> CaptureRun::wait_for_space() {
  std::uintmax_t needed = spare_bytes;
  for (const TakenFrame& taken : store_.in_hand()) {
    needed += 2 * taken.frame.counts.counts.size() * sizeof(std::uint32_t);
  }
  const auto backoff = std::min(longest_backoff, pause_beat * (1 << std::min(space_waits_, 10)));
  ++space_waits_;
  const auto began = std::chrono::steady_clock::now();
  const std::string reason = fmt::format(
      "the disk of '{}' is full: free at least {:.1f} MB there; the session then goes on by itself",
      t_.folder.root.string(), static_cast<double>(needed) / 1e6);
  return pause("no_space", reason, [&, this](bool word) -> Result<bool> {
    if (word) return true;
    if (std::chrono::steady_clock::now() - began < backoff) return false;
    std::error_code problem;
    const auto space = std::filesystem::space(t_.folder.root, problem);
    return !problem && space.available >= needed;
  });
}

/// Journals an event, waiting for the disk where it is full.
Result<void> CaptureRun::note(const std::string& event, nlohmann::ordered_json fields) {
  while (true) {
    auto noted = try_note(event, fields);
    if (noted || noted.error().code != ErrorCode::no_space) return noted;
    if (auto waited = wait_for_space(); !waited) return waited;
  }
}

Result<void> CaptureRun::try_note(const std::string& event, const nlohmann::ordered_json& fields) {
  const auto appended = journal_.append(event, fields);
  if (!appended) return tl::unexpected(appended.error());
  if (t_.listeners.event) t_.listeners.event(*appended);
  return {};
}

void CaptureRun::say(const std::string& activity) {
  activity_ = activity;
  if (!t_.listeners.progress) return;
  SessionProgress progress;
  progress.activity = activity;
  progress.shots_done = static_cast<int>(captured_.shots.size());
  progress.shots_total = static_cast<int>(t_.prepared.plan.shots.size());
  progress.elapsed_s = elapsed();
  progress.remaining_s = remaining();
  progress.predicted_error_percent = t_.prepared.plan.mean_only_error_percent;
  if (const auto point = alongside_.latest()) {
    progress.predicted_error_percent = point->predicted_error_percent;
    progress.held_out_error_percent = point->held_out_error_percent;
    progress.true_error_percent = point->true_error_percent;
  }
  progress.curve = alongside_.curve();
  progress.gantry = hand_.last_status();
  if (hand_.lamp_known_dark()) progress.lamp_power = 0;
  if (hand_.lamp_known_on()) progress.lamp_power = t_.rig.lamp.power;
  t_.listeners.progress(progress);
}

/// What waits for the reduction alongside goes on telling that it does.
Patience CaptureRun::patience() {
  return {t_.control.stop_token(), [this] { say(activity_); }};
}

double CaptureRun::elapsed() const {
  return elapsed_before_ + std::chrono::duration<double>(t_.clock.now() - began_).count();
}

double CaptureRun::remaining() const {
  double seconds = captured_.darks.empty() ? predicted_.dark : 0;
  for (const ShotTime& shot : predicted_.shots) {
    const bool in_hand = pending_ && pending_->index == shot.shot;
    if (!in_hand && !is_captured(shot.shot)) seconds += shot.total();
  }
  return seconds;
}

/// What [stop] minutes has against a light at which the gantry stands already, or "": too little
/// is left for the rest of it. One light is taken in any case.
std::string CaptureRun::out_of_time(int next, bool any_fitted) const {
  const auto& minutes = t_.spec.stop.minutes;
  if (!minutes || !any_fitted) return {};
  const double left = 60 * *minutes - elapsed();
  if (left <= 0) return fmt::format("[stop] minutes = {} have passed", *minutes);
  const auto step = std::ranges::find(predicted_.shots, next, &ShotTime::shot);
  if (step == predicted_.shots.end()) return {};
  const double takes = step->warm_up + step->exposures;
  if (takes <= left) return {};
  return fmt::format("[stop] minutes = {}: {} may take {:.1f} s more, and {:.1f} s are left",
                     *minutes, name_of_shot(next), takes, left);
}

}  // namespace lightrig
