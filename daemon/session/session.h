#pragma once

#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <functional>
#include <memory>
#include <mutex>
#include <stop_token>
#include <string>
#include <string_view>
#include <vector>

#include "config/rig.h"
#include "daemon/session/curve_point.h"
#include "daemon/session/journal.h"
#include "daemon/session/patience.h"
#include "daemon/session/prepare.h"
#include "daemon/session/session_folder.h"
#include "drivers/devices.h"

namespace lightrig {

/// What a person may ask of a running session; called from any thread. Abort and halt are the stop
/// token, seen by every device call.
class SessionControl {
 public:
  void pause(std::string reason);  ///< after the exposure in progress, lamp dark until resume()
  void resume();                   ///< goes on from any pause whose cause is gone
  void stop_after_shot();          ///< ends `stopped_early` when the shot in progress is stored
  void abort(std::string reason);  ///< device calls return within 10 ms; ends `aborted`
  void halt(std::string reason);   ///< as abort, but ends `paused`: the service itself has to stop

  std::stop_token stop_token() const { return stop_.get_token(); }
  bool pause_requested() const;
  bool stop_after_shot_requested() const;
  bool halted() const;
  std::string reason() const;

  /// A resume() from before this does not count: nobody can have meant what was not yet told.
  void forget_word();
  /// Waits for a person's resume() or the stop token, at most this long (real time: people do not
  /// run on the rig's clock). True when one of them came.
  bool wait_for_word(std::chrono::milliseconds at_most);

 private:
  mutable std::mutex mutex_;
  std::condition_variable_any word_;
  std::stop_source stop_;
  bool pause_ = false;
  bool resumed_ = false;
  bool stop_after_shot_ = false;
  bool halted_ = false;
  std::string reason_;
};

/// One moment of a session, for whoever watches.
struct SessionProgress {
  std::string activity;  ///< "homing", "dark frames", "moving to L03", "exposing L03 2/5", …
  int shots_done = 0, shots_total = 0;
  double elapsed_s = 0, remaining_s = 0;  ///< rig time
  double predicted_error_percent = 0;     ///< with what is captured so far
  std::optional<double> held_out_error_percent, true_error_percent;
  /// One point per light as far as they are reduced alongside, also those of earlier parts of a
  /// session that is resumed.
  std::vector<CurvePoint> curve;
  std::optional<GantryStatus> gantry;  ///< as last read
  std::optional<double> lamp_power;    ///< [0, 1]; empty while it is not known
};

enum class SessionOutcome : std::uint8_t { done, stopped_early, paused, aborted, faulted };

struct SessionEnd {
  SessionOutcome outcome = SessionOutcome::done;
  std::string reason;  ///< one sentence for a person; says LAMP MAY BE ON where that is so
  bool lamp_may_be_on = false;
  bool waits_for_space = false;  ///< faulted before its first line: its disk is full
};

/// Who is told; each may be empty. All are called by the capturing thread, which waits for them:
/// they hand over and return. `progress` comes at least twice a second while the session pauses or
/// waits for the disk or the reduction, and with every step otherwise: a watchdog may feed on it.
struct SessionListeners {
  std::function<void(const JournalEvent&)> event;  ///< after it is durable
  std::function<void(const SessionProgress&)> progress;
  std::function<void(const Frame&, const std::string& shot)>
      frame;  ///< each stored frame, for a preview
  /// Before a shot is begun, with how many times it was taken back before: a simulated rig makes
  /// new noise of it (sim::World::set_take).
  std::function<void(const std::string& shot, std::uint64_t take)> shot_begins;
  /// Once it has ended and touches no device any more, which may be given back then: capture()
  /// itself returns when the light that is being reduced alongside is done.
  std::function<void(const SessionEnd&)> ended;
};

/// What is opened anew: where gantry and lamp still answer, the camera alone; where the gantry
/// answers and a lamp on a wire of its own does not, that lamp alone. A gantry that is closed and
/// opened loses its home position with some controllers, and the patience of its drives' watchdog
/// with others.
enum class Reopen : std::uint8_t { everything, camera, lamp };
/// Opens devices anew after a disconnection; the old ones are destroyed before. The old camera,
/// unless it is kept, is handed over, since even the end of a dead one may take seconds. Where
/// opening blocks, it is left behind on a stop. Errors: the devices', `stopped`.
using ReopenDevices = std::function<Result<Devices>(Reopen what, std::unique_ptr<Camera> old,
                                                    const std::stop_token& stop)>;

/// UTC date, time and sample id, safe as a file name: "20261122T031500Z-brass-3".
std::string make_session_id(const SessionSpec& spec, std::chrono::system_clock::time_point now);

/// Creates the folder of a new session, whole or not at all: copies of the inputs, plan.json,
/// session.json, a journal that says "opened". Errors: no_space, refused (unwritable root, id taken
/// or not a plain file name), with the path.
Result<SessionFolder> create_session(const Rig& rig, const SessionSpec& spec,
                                     const Prepared& prepared, const std::string& id);

/// Captures what the folder's journal does not yet hold: home, dark frames, then each shot in visit
/// order — move, settle, verify, ambient, metering, bracket, verify, store, journal — reducing
/// alongside. Where a light lost rows that the plan counted on, lights still to come may give way
/// to others; `prepared` and the journal then hold the plan as it has become [replan.h]. Returns
/// when done, stopped, paused with no way on, aborted or faulted; the lamp is dark then, or the end
/// says LAMP MAY BE ON. Resuming is calling it again: after homing, a reference frame is compared
/// with the last shot's. Frames that no journal entry vouches for are moved to rejected/. Without
/// `reopen` a lost device ends the session.
SessionEnd capture(const SessionFolder& folder, const Rig& rig, const SessionSpec& spec,
                   Prepared& prepared, Devices& devices, Clock& clock, SessionControl& control,
                   const SessionListeners& listeners, const ReopenDevices& reopen = {});

/// Takes a shot back, so that the next capture() takes it anew; its frames go to rejected/. Errors:
/// not_found when no such shot is captured, refused while the session is being captured.
Result<void> retake_shot(const SessionFolder& folder, const std::string& name);

/// Journals "sealed" and writes manifest-sha256.txt over every file of the folder (BagIt's manifest
/// lines). Doing it again is harmless. Beats with every file; it is not stopped. Errors: refused
/// while the session is being captured or not ended, no_space.
Result<void> seal_session(const SessionFolder& folder, const Patience& patience = {});

std::string_view name_of(SessionOutcome outcome);

}  // namespace lightrig
