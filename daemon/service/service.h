#pragma once

#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <deque>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <span>
#include <string>
#include <thread>
#include <vector>

#include "config/rig.h"
#include "daemon/service/event_hub.h"
#include "daemon/service/liveness.h"
#include "daemon/service/log.h"
#include "daemon/service/preview.h"
#include "daemon/service/rig_access.h"
#include "daemon/service/state.h"
#include "daemon/session/session.h"

namespace lightrig {

/// Who asks: a name for the lock and the record, and where the request came from.
struct Caller {
  std::string name;
  std::string peer;
};

/// A rig reserved by a person. It keeps others' hands off, never ABORT's.
struct RigLock {
  std::string name, note;
};

/// What became of a command.
struct CommandRecord {
  std::uint64_t id = 0;
  std::string name;               ///< "arm", "home", "jog", "session", …
  std::string state = "running";  ///< then "done" or "failed"
  std::string message;            ///< what was done, or why not
};

/// The session in hand, or the last one.
struct SessionView {
  std::string id;
  std::filesystem::path folder;
  std::string state;      ///< "planning", "capturing", "paused", "reducing", "done", "aborted", …
  std::string reason;     ///< why it is paused, aborted or faulted; one sentence
  std::string paused_by;  ///< "person", "condition" or "no_space" while it is paused, else ""
  SessionProgress progress;
  bool pause_requested = false, stop_requested = false;
  std::vector<CurvePoint> curve;
  std::filesystem::path result;  ///< folder of the result; empty before it stands
};

/// What was last found of a device, by looking for it or by opening it.
struct DeviceLook {
  std::string device;
  bool good = false;
  std::string said;
  double age_s = 0;  ///< [s] since then
};

/// One consistent moment of the service.
struct Snapshot {
  std::string rig;
  bool simulated = false;
  State state = State::unarmed;
  double state_s = 0;   ///< [s] in this state
  double uptime_s = 0;  ///< [s]
  bool busy = false;    ///< the command slot is taken
  bool lamp_may_be_on = false;
  std::vector<std::string> why_not_ready;
  std::vector<DeviceLook> self_test;  ///< empty where the rig is simulated
  std::optional<RigLock> lock;
  std::optional<RigFacts> facts;  ///< while devices are open
  std::optional<SessionView> session;
  std::vector<CommandRecord> commands;  ///< the last few, newest last
  std::uintmax_t disk_free_bytes = 0;
  std::uint64_t frames = 0, sessions_done = 0, aborts = 0, faults = 0;  ///< since start
};

/// What a session is to be.
struct StartRequest {
  SessionSpec spec;
  std::optional<Plan> plan;  ///< given, or computed
  std::string key;           ///< repeated requests with one key start one session; "" = no key
};

enum class SessionVerb : std::uint8_t { pause, resume, stop, halt, abort };
std::string_view name_of(SessionVerb verb);

struct ServiceSettings {
  Rig rig;
  bool simulate = false;
  double clock_rate = 1;
  int threads = 2;  ///< for reduction
};

/// The service itself: the state, one command slot served by the session thread, and the snapshot
/// that everybody else reads. Every call returns at once; what takes time happens on the session
/// thread, which alone touches a device.
class Service {
 public:
  Service(ServiceSettings settings, const Log& log, EventHub& hub, Liveness& liveness);
  ~Service();  ///< shut_down()
  Service(const Service&) = delete;
  Service& operator=(const Service&) = delete;

  // Commands answer with the number of their record; `refused` says what stands in the way. A
  // command whose end is reached already is done at once.
  Result<std::uint64_t> arm(const Caller& caller);
  Result<std::uint64_t> disarm(const Caller& caller);
  Result<std::uint64_t> clear(const Caller& caller);
  Result<std::uint64_t> home(const Caller& caller);
  // Requests repeated under one key are carried out once; "" is no key.

  /// Moves one axis by, or to, a value [rad or m].
  Result<std::uint64_t> jog(const Caller& caller, const std::string& axis, double value,
                            bool relative, const std::string& key = "");

  /// Sets the lamp of an armed rig [0, 1]; its lease makes it dark again, and so does whatever ends
  /// the arming.
  Result<std::uint64_t> lamp(const Caller& caller, double power, const std::string& key = "");
  /// Takes one frame for the preview, with the lamp lit and warmed up for it where `lit`, dark
  /// afterwards.
  Result<std::uint64_t> snap(const Caller& caller, double exposure, bool lit,
                             const std::string& key = "");

  /// The id of the session, planning from now on.
  Result<std::string> start(const Caller& caller, StartRequest request);

  /// Pause, resume, stop after this shot, halt (at once; it can be resumed), or abort. `id` is the
  /// session in hand, or, to resume, any unfinished one of the session root. Asking for what is so
  /// already is no error. The command's number: its record ends `done` when what was asked for has
  /// come, `failed` when the session ended first or a deadline has passed (operations.md).
  Result<std::uint64_t> steer(const Caller& caller, const std::string& id, SessionVerb verb);

  /// Stops whatever moves: requests the stop before it does anything else, takes no queue.
  void abort(const Caller& caller, const std::string& reason);
  /// Adds to an abort what it was for: it may come later than the stop. `given` is the reason that
  /// abort() had; where another has come since, that one stays.
  void explain_abort(const Caller& caller, const std::string& given, const std::string& why);

  Result<void> lock(const Caller& caller, const std::string& note);
  /// `force` takes the lock from whoever holds it.
  Result<void> unlock(const Caller& caller, bool force);
  /// Errors: refused when somebody else holds the lock.
  Result<void> may_command(const Caller& caller) const;

  Snapshot snapshot() const;
  Preview& preview() { return preview_; }
  const Rig& rig() const { return settings_.rig; }
  bool simulated() const { return settings_.simulate; }

  /// Looks at the disk; to be called every few seconds, from a thread that may wait.
  void look_at_disk();

  /// Looks whether the rig's real devices are there (reach_of), while nothing is under way; to be
  /// called about twice a minute, from a thread that may wait for a second. Opens none.
  void look_at_devices();

  /// Aborts what is under way, makes the lamp dark, ends the session thread.
  void shut_down();

 private:
  using SteadyClock = std::chrono::steady_clock;
  using Work = std::function<Result<std::string>(SessionControl&)>;
  struct Command {
    std::uint64_t id;
    std::string name;
    Work work;
    std::unique_ptr<SessionControl> control;
  };
  /// What a session's view says where it is not the state's own name.
  struct SessionWords {
    std::string state, paused_by;
  };

  // service.cpp: the slot and the state, for any thread
  Result<std::uint64_t> submit(const std::string& name, const Caller& caller, Event event, bool now,
                               Work work, std::optional<SessionView> session = {},
                               const std::string& key = "");
  Result<std::uint64_t> done_already(const std::string& name, const std::string& message);
  bool apply(Event event, const std::string& reason = "", const SessionWords& words = {});
  bool apply_unless_stopped(Event event, const SessionControl& control);
  void set_state(State state, const std::string& reason,
                 const SessionWords& words = {});  ///< under mutex_
  void keep_record(CommandRecord record);          ///< under mutex_
  void record_end(std::uint64_t id, const Result<std::string>& end);
  void tell_state();
  std::vector<std::string> obstacles() const;  ///< under mutex_

  // steering.cpp: an operator's hand on the session, under mutex_
  SessionControl* control_of(const std::string& id) const;  ///< null: not in hand
  Result<std::uint64_t> steer_in_hand(SessionControl& control, const std::string& by,
                                      SessionVerb verb);
  void settle_steering();

  // session_thread.cpp: the session thread's own
  void run();
  void execute(const Command& command);
  Result<void> darken();
  void tell_from_the_beginning(const SessionFolder& folder);
  Result<std::string> not_begun(const SessionControl& control, const std::string& what);
  void drop_waiting(const std::string& why);  ///< under mutex_: the command that was not begun
  void settle_devices();
  void idle_check();
  Result<std::string> do_arm(SessionControl& control);
  Result<std::string> do_home(SessionControl& control);
  Result<std::string> do_jog(SessionControl& control, const std::string& axis, double value,
                             bool relative);
  Result<std::string> do_lamp(SessionControl& control, double power);
  Result<std::string> do_snap(SessionControl& control, double exposure, bool lit);
  void remember(const RigFacts& facts);
  void lamp_unsure(bool unsure);
  void found(const std::string& device, bool good, const std::string& said);  ///< under mutex_
  void opened(const Result<RigFacts>& facts);

  // session_run.cpp: one session on the session thread
  Result<std::string> do_session(SessionControl& control, const std::string& id,
                                 StartRequest request);
  Result<std::string> do_resume(SessionControl& control, const std::filesystem::path& folder);
  Result<std::string> finish_resumed(SessionControl& control, const SessionRecord& record);
  Result<void> add_truth(SessionSpec& spec);
  Result<std::string> run_session(SessionControl& control, const SessionFolder& folder,
                                  const SessionSpec& spec, Prepared& prepared);
  void end_capture(const SessionControl& control, const SessionEnd& end);
  Result<std::string> finish_session(SessionControl& control, const SessionFolder& folder,
                                     const SessionEnd& end);
  Result<std::string> reduce(SessionControl& control, const SessionFolder& folder);
  Result<void> while_there_is_space(SessionControl& control, const std::filesystem::path& folder,
                                    Event goes_on, const std::function<Result<void>()>& step);
  Result<void> wait_for_space(SessionControl& control, const std::filesystem::path& folder,
                              std::chrono::seconds longest);
  Result<std::string> refuse_session(const Error& error);
  std::chrono::milliseconds longest_step() const;
  Patience computing(const SessionControl& control);

  // session_told.cpp: what a session tells on its way
  void on_event(const JournalEvent& event);
  void on_progress(const SessionProgress& progress);
  void on_frame(const Frame& frame, const std::string& shot);
  void on_points(std::span<const CurvePoint> points);

  const ServiceSettings settings_;
  const Log& log_;
  EventHub& hub_;
  Liveness& liveness_;
  Preview preview_;
  RigAccess access_;     ///< the session thread's
  ObjectConfig object_;  ///< the session thread's: what stands there as far as it was last told
  const SteadyClock::time_point started_ = SteadyClock::now();

  mutable std::mutex mutex_;
  std::condition_variable changed_;
  State state_ = State::unarmed;
  bool session_in_hand_ = false;  ///< session_ is what the command being run is about
  bool lamp_may_be_on_ = false;
  bool stopping_ = false;
  SteadyClock::time_point state_since_ = started_;
  std::string state_reason_;
  std::optional<Command> slot_;       ///< waits for the session thread
  SessionControl* active_ = nullptr;  ///< of the command being run; the session thread owns it
  std::uint64_t last_id_ = 0;
  std::deque<CommandRecord> commands_;
  struct Steering {
    std::uint64_t id = 0;
    SessionVerb verb{};
    SteadyClock::time_point until;
    std::chrono::seconds within{};
  };
  std::vector<Steering> steering_;  ///< asked for, and not come yet
  std::optional<RigLock> lock_;
  std::optional<RigFacts> facts_;
  std::optional<SessionView> session_;
  struct {
    std::string key, id;
  } last_start_;  ///< the idempotency key of the last accepted start, and the session it began
  struct Keyed {
    std::string key;
    std::uint64_t id = 0;
  };
  std::map<std::string, Keyed> last_keyed_;  ///< the same of other commands by name, and their ids
  struct Found {
    bool good = false;
    std::string said;
    SteadyClock::time_point at;
  };
  std::map<std::string, Found> found_;  ///< of devices that are real, by name
  std::uint64_t openings_ = 0;
  std::string disk_trouble_;
  std::uintmax_t disk_free_bytes_ = 0;
  /// What the last ABORT struck, for the reason that follows it.
  struct Aborted {
    const SessionControl* command = nullptr;  ///< until it ends
    std::string session;
    std::string given, explained;  ///< its reason, and with what came later; "" before
  };
  Aborted aborted_;
  std::uint64_t frames_ = 0, sessions_done_ = 0, aborts_ = 0, faults_ = 0;
  std::thread thread_;  ///< last: it uses all of the above
};

}  // namespace lightrig
