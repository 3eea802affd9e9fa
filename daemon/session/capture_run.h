#pragma once

#include <chrono>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "daemon/session/alongside.h"
#include "daemon/session/capture_time.h"
#include "daemon/session/device_hand.h"
#include "daemon/session/frame_store.h"
#include "daemon/session/light_witness.h"
#include "daemon/session/lit_sites.h"
#include "daemon/session/pose_check.h"
#include "daemon/session/retry.h"
#include "daemon/session/session.h"
#include "daemon/session/session_upkeep.h"

namespace lightrig {

/// What a capture works with, lent by its caller for as long as it runs.
struct CaptureTools {
  const SessionFolder& folder;
  const Rig& rig;
  const SessionSpec& spec;
  Prepared& prepared;  ///< its plan changes where the session replans
  Devices& devices;
  Clock& clock;
  SessionControl& control;
  const SessionListeners& listeners;
  const ReopenDevices& reopen;
};

/// How a part of a session ends that no error ended.
struct Ending {
  SessionOutcome outcome = SessionOutcome::done;
  std::string reason;
};

/// Between looks at what a pause waits for; real time, since people wait too.
inline constexpr std::chrono::milliseconds pause_beat{250};

/// A shot that is being taken, or taken and verified and not yet journaled; its frames are the
/// store's.
struct TakenShot {
  int index = -1;
  std::vector<double> skipped;  ///< [s]
  GantryPosition stood_at;      ///< as read after the last exposure
  std::string finished_at;      ///< UTC
};

/// One call of capture(). The story is told in capture_run.cpp, one shot in capture_shot.cpp,
/// waiting and recovering in capture_recover.cpp, what else it waits for in capture_watch.cpp, the
/// second look at the plan in capture_replan.cpp.
class CaptureRun {
 public:
  CaptureRun(const CaptureTools& tools, Journal journal, Captured captured);
  SessionEnd run();

 private:
  // The story.
  Result<Ending> story();
  Result<void> begin();
  Result<void> home();
  Result<void> ensure_darks();
  Result<std::optional<Ending>> compare_reference();
  Result<FrameLikeness> reference_likeness(const CapturedShot& shot, const StoredFrame& stored);
  Result<void> note_reference(const std::string& name, bool like, const FrameLikeness& likeness);
  Result<std::optional<Ending>> capture_next(int index);
  std::optional<Ending> early_ending(int next);
  std::string out_of_time(int next, bool any_fitted) const;
  Result<void> collect_shot();
  Result<void> look_at_pose(bool more_to_come);
  CapturedShot describe(std::vector<StoredFrame> stored) const;
  nlohmann::ordered_json shot_fields(const CapturedShot& captured) const;
  SessionEnd finish(const Result<Ending>& ending);
  bool end_dark();
  std::string save_what_is_in_hand();

  // The rest of the plan.
  std::optional<int> next_light() const;
  Result<void> replan_after_losses();
  Result<void> replan_after(std::size_t last);

  // One shot.
  Result<void> approach(int index);
  Result<TakenShot> take_shot(int index);
  Result<LightWitness> take_ambient(const TakenShot& shot);
  Result<std::vector<double>> meter(TakenShot& shot, LightWitness& witness);
  Result<void> expose_lit(int index, const std::string& name, const std::string& role,
                          double exposure, LightWitness& witness);
  Result<void> believe(const Frame& frame, LightWitness& witness);
  Result<void> close_bracket(int index, LightWitness& witness);
  Result<void> still_in_place(const GantryPosition& target);
  Result<TakenFrame> take(const std::string& folder, const std::string& name,
                          const std::string& role, double exposure);
  std::string exposure_name(double exposure) const;
  Result<void> checkpoint(const GantryPosition& target);

  // Waiting and recovering.
  template <class Attempt>
  auto persevere(const std::string& step, Attempt attempt) -> decltype(attempt());
  Result<void> recover(const std::string& step, Error error, RetryTally& tally);
  Result<void> reopen();
  Result<void> look(const std::optional<Error>& unless_mended);
  Result<void> pause_for_person();
  Result<void> pause_for_interlocks(const std::vector<std::string>& names);
  Result<void> wait_for_space();
  template <class MayGoOn>
  Result<void> pause(const char* why, const std::string& reason, MayGoOn may_go_on);

  // Conditions.
  Result<void> watch_conditions();
  template <class Tell, class Look>
  Result<bool> hold(const PauseRule& rule, double reading, Tell tell, Look look);
  Result<bool> pause_for_packets();
  Result<bool> pause_for_lamp();
  Result<void> pause_for_heat();
  Result<void> dark_look();
  Result<StoredFrame> drift_reference();
  Result<void> watch_lamp();

  // Telling.
  Result<void> note(const std::string& event, nlohmann::ordered_json fields);
  Result<void> try_note(const std::string& event, const nlohmann::ordered_json& fields);
  void say(const std::string& activity);
  Patience patience();
  double elapsed() const;
  double remaining() const;
  bool is_captured(int index) const;
  const Shot& planned(int index) const;
  std::string name_of_shot(int index) const;

  const CaptureTools& t_;
  Journal journal_;
  Captured captured_;
  DeviceHand hand_;
  FrameStore store_;
  Alongside alongside_;
  CaptureTime predicted_;
  std::optional<TakenShot> pending_;  ///< in the store, not journaled
  /// Of the captured shots so many have been asked what they mean for the rest of the plan. Of
  /// those of an earlier part all but the last two were, before the next but one was begun.
  std::size_t decided_ = 0;
  TimePoint began_;
  double elapsed_before_ = 0;  ///< [s] of earlier parts
  std::string activity_;
  bool homed_ = false;
  int rehomings_ = 0;
  int space_waits_ = 0;        ///< in a row without anything stored between
  int lights_since_look_ = 0;  ///< captured since the lamp was last looked at
  int lamp_doubts_ = 0;        ///< in a row, that a picture raised against what the lamp says
  std::string lamp_doubt_;     ///< the last of them
  std::optional<StoredFrame> drift_reference_;
  PoseStanding pose_;
  Error dark_problem_;  ///< why the lamp could not be switched off, if so
};

/// Waits with the lamp dark until `may_go_on` says so (Result<bool>; asked every beat, told whether
/// a person said to resume). Errors: stopped, and those of may_go_on and the journal.
template <class MayGoOn>
Result<void> CaptureRun::pause(const char* why, const std::string& reason, MayGoOn may_go_on) {
  if (auto dark = hand_.lamp_dark(); !dark && !hand_.lamp_known_dark()) return dark;
  const nlohmann::ordered_json fields{{"why", why},
                                      {"reason", reason},
                                      {"measured", {{"at", utc_now()}, {"elapsed_s", elapsed()}}}};
  const std::string before = activity_;
  t_.control.forget_word();
  // On a full disk this line may have to wait for the end of the pause.
  bool paused_noted = static_cast<bool>(try_note("paused", fields));
  while (true) {
    say("paused: " + reason);
    const bool word = t_.control.wait_for_word(pause_beat);
    if (hand_.stop_requested()) return fail(ErrorCode::stopped, "stopped while paused");
    const Result<bool> go_on = may_go_on(word);
    if (!go_on) return tl::unexpected(go_on.error());
    if (!*go_on) continue;
    if (!paused_noted) paused_noted = static_cast<bool>(try_note("paused", fields));
    const auto resumed =
        try_note("resumed", {{"measured", {{"at", utc_now()}, {"elapsed_s", elapsed()}}}});
    if (resumed) break;
    if (resumed.error().code != ErrorCode::no_space) return resumed;
  }
  say(before);
  return {};
}

/// Repeats a step as the retry policy says.
template <class Attempt>
auto CaptureRun::persevere(const std::string& step, Attempt attempt) -> decltype(attempt()) {
  RetryTally tally;
  while (true) {
    auto result = attempt();
    if (result) return result;
    if (auto recovered = recover(step, result.error(), tally); !recovered) {
      return tl::unexpected(recovered.error());
    }
  }
}

}  // namespace lightrig
