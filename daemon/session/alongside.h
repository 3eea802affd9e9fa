#pragma once

#include <chrono>
#include <condition_variable>
#include <deque>
#include <functional>
#include <mutex>
#include <optional>
#include <stop_token>
#include <string>
#include <thread>

#include "core/pose_fit.h"
#include "daemon/session/patience.h"
#include "daemon/session/reduction.h"
#include "daemon/session/replan.h"

namespace lightrig {

/// Reduces shots while the next ones are captured, on a thread of its own, so that the error so far
/// is known. What it finds is for watching and for stopping early; the session's result is always
/// reduced again from the folder. The queue never holds more shots than the plan has.
class Alongside {
 public:
  Alongside(const Rig& rig, const SessionSpec& spec, const Prepared& prepared,
            const SessionFolder& folder);
  /// Ends the thread within a stage (a frame, a merge, a fit) of the shot it is at; that and what
  /// is queued is left.
  ~Alongside();
  Alongside(const Alongside&) = delete;
  Alongside& operator=(const Alongside&) = delete;

  /// Begins, once the dark frames are known. With `judge_pose` shots are looked at for the object's
  /// pose, before anything else, until opinion() is decided.
  void start(std::vector<StoredFrame> darks, bool judge_pose);
  void add(CapturedShot shot);

  /// The newest estimate.
  std::optional<CurvePoint> latest() const;
  /// The estimates so far, one per fitted light in the order they were added.
  std::vector<CurvePoint> curve() const;

  // Who waits lends the thread its own priority, where that is allowed (CAP_SYS_NICE, RLIMIT_NICE),
  // and is told several times a second that they do, as long as the thread gets something
  // done (a frame read, a merge, a fit) at least every five minutes. A resumed session brings its
  // whole queue at once.

  /// The estimate over all that was added; waits for it. Empty when stopped, failed or nothing was
  /// added.
  std::optional<CurvePoint> wait_for_all(const Patience& patience);
  /// What the first lights added gave (question.yields of them), and whether others should take the
  /// place of those still open; waits for both. Empty when stopped, failed, or the plan may stand.
  struct Answer {
    LightYield last;
    Replan changes;
  };
  std::optional<Answer> replan(ReplanQuestion question, const Patience& patience);
  /// How the object lies, by the shots added that it takes to decide on it, or, where those up to
  /// the shot of this name do not, by these; waits for it. Errors: stopped, and those of reading
  /// the frames.
  struct PoseSeen {
    PoseFit fit;
    std::string shot;       ///< that it was judged by
    bool decided = false;   ///< see PoseOpinion
    std::string agreed_by;  ///< the shot that agrees that the pose is wrong, or ""
  };
  Result<PoseSeen> wait_for_pose(const std::string& shot, const Patience& patience);
  /// Whether a shot has told how the object lies, or looking for it has failed: nobody would wait.
  bool pose_is_settled() const;
  /// The first failure, once; "" when there is none.
  std::string take_problem();

 private:
  void run(const std::stop_token& stop, std::vector<StoredFrame> darks);
  void got_on();
  void have_nice(int value);
  void reduce_next(Reduction& reduction, const std::stop_token& stop,
                   std::unique_lock<std::mutex>& lock);
  void answer(std::unique_lock<std::mutex>& lock);
  template <class Ready>
  bool wait(std::unique_lock<std::mutex>& lock, const Patience& patience, Ready ready);

  const Rig& rig_;
  const SessionSpec& spec_;
  const Prepared& prepared_;
  SessionFolder folder_;
  mutable std::mutex mutex_;
  std::condition_variable_any changed_;
  std::deque<CapturedShot> queue_;
  bool working_ = false;
  static constexpr int nice_alongside = 10;
  int nice_ = nice_alongside;  ///< that the thread is to have …
  int tid_ = 0;                ///< … once it runs, and this is known
  std::chrono::steady_clock::time_point last_done_ = std::chrono::steady_clock::now();
  bool failed_ = false;
  std::string problem_;
  std::optional<CurvePoint> latest_;
  std::vector<CurvePoint> curve_;
  std::vector<LightYield> yields_;  ///< of the shots added, in order
  std::optional<ReplanQuestion> question_;
  std::optional<Answer> answer_;
  bool pose_wanted_ = false;
  std::vector<PoseFit> looks_;          ///< at the pose so far …
  std::vector<std::string> looked_at_;  ///< … by the shots of these names
  std::optional<Error> pose_failed_;
  std::jthread thread_;  ///< last: it uses all of the above
};

}  // namespace lightrig
