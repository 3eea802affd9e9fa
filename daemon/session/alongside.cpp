#include "daemon/session/alongside.h"

#include <sys/resource.h>
#include <unistd.h>

#include <memory>
#include <utility>

#include "core/check.h"
#include "daemon/session/pose_check.h"
#include "daemon/session/pose_opinion.h"

namespace lightrig {
namespace {

constexpr std::chrono::milliseconds beat{200};
constexpr std::chrono::minutes longest_silence{5};  ///< between two things got done

// On Linux a nice value is a thread's own. Without the right to it, things go on as they were.
void set_nice(int tid, int value) {
  (void)::setpriority(PRIO_PROCESS, static_cast<id_t>(tid), value);
}

int own_nice() { return ::getpriority(PRIO_PROCESS, static_cast<id_t>(::gettid())); }

}  // namespace

Alongside::Alongside(const Rig& rig, const SessionSpec& spec, const Prepared& prepared,
                     const SessionFolder& folder)
    : rig_(rig), spec_(spec), prepared_(prepared), folder_(folder) {}

Alongside::~Alongside() {
  if (!thread_.joinable()) return;
  thread_.request_stop();
  {
    const std::lock_guard lock(mutex_);
    have_nice(own_nice());
  }
  thread_.join();
}

void Alongside::have_nice(int value) {
  nice_ = value;
  if (tid_ != 0) set_nice(tid_, value);
}

void Alongside::start(std::vector<StoredFrame> darks, bool judge_pose) {
  CHECK(!thread_.joinable());
  pose_wanted_ = judge_pose;
  thread_ = std::jthread(
      [this, held = std::move(darks)](const std::stop_token& stop) { run(stop, held); });
}

void Alongside::add(CapturedShot shot) {
  {
    const std::lock_guard lock(mutex_);
    if (queue_.empty() && !working_) last_done_ = std::chrono::steady_clock::now();
    queue_.push_back(std::move(shot));
  }
  changed_.notify_all();
}

std::optional<CurvePoint> Alongside::latest() const {
  const std::lock_guard lock(mutex_);
  return latest_;
}

std::vector<CurvePoint> Alongside::curve() const {
  const std::lock_guard lock(mutex_);
  return curve_;
}

template <class Ready>
bool Alongside::wait(std::unique_lock<std::mutex>& lock, const Patience& patience, Ready ready) {
  if (ready()) return true;
  // While somebody waits, nobody's work is to go before: on a busy machine the session would wait
  // for everybody else's.
  have_nice(own_nice());
  const auto back = [this](void*) { have_nice(nice_alongside); };
  const std::unique_ptr<void, decltype(back)> lent(this, back);
  while (!changed_.wait_for(lock, patience.stop, beat, ready)) {
    if (patience.stop.stop_requested()) return false;
    if (std::chrono::steady_clock::now() - last_done_ > longest_silence) continue;
    lock.unlock();  // who is told may ask for the newest estimate
    patience.beat();
    lock.lock();
  }
  return true;
}

std::optional<CurvePoint> Alongside::wait_for_all(const Patience& patience) {
  std::unique_lock lock(mutex_);
  const bool done =
      wait(lock, patience, [this] { return failed_ || (queue_.empty() && !working_); });
  return done && !failed_ ? latest_ : std::nullopt;
}

std::optional<Alongside::Answer> Alongside::replan(ReplanQuestion question,
                                                   const Patience& patience) {
  std::unique_lock lock(mutex_);
  if (failed_) return std::nullopt;
  if (queue_.empty() && !working_) last_done_ = std::chrono::steady_clock::now();
  question_ = std::move(question);
  answer_.reset();
  changed_.notify_all();
  const bool done = wait(lock, patience, [this] { return failed_ || !question_.has_value(); });
  return done && !failed_ ? std::exchange(answer_, std::nullopt) : std::nullopt;
}

Result<Alongside::PoseSeen> Alongside::wait_for_pose(const std::string& shot,
                                                     const Patience& patience) {
  std::unique_lock lock(mutex_);
  const bool known = wait(lock, patience, [&] {
    return pose_failed_ || (!looks_.empty() && (looked_at_.back() == shot || !pose_wanted_));
  });
  if (!known) return fail(ErrorCode::stopped, "looking for the object's pose was stopped");
  if (pose_failed_) return tl::unexpected(*pose_failed_);
  const PoseOpinion held = opinion(looks_);
  return PoseSeen{looks_[held.by], looked_at_[held.by], held.decided,
                  held.second ? looked_at_[*held.second] : std::string()};
}

bool Alongside::pose_is_settled() const {
  const std::lock_guard lock(mutex_);
  return !pose_wanted_;
}

std::string Alongside::take_problem() {
  const std::lock_guard lock(mutex_);
  return std::exchange(problem_, {});
}

void Alongside::run(const std::stop_token& stop, std::vector<StoredFrame> darks) {
  // One thread: the motion leaves time enough, and neither the session thread nor an ABORT may wait
  // for a core that does arithmetic.
  std::unique_lock lock(mutex_);
  tid_ = ::gettid();
  have_nice(nice_);
  lock.unlock();
  Reduction reduction(rig_, spec_, prepared_, folder_, std::move(darks),
                      {.threads = 1, .patience = {stop, [this] { got_on(); }}});
  lock.lock();
  while (changed_.wait(lock, stop, [this] { return !queue_.empty() || question_.has_value(); })) {
    if (stop.stop_requested()) return;
    queue_.empty() ? answer(lock) : reduce_next(reduction, stop, lock);
    last_done_ = std::chrono::steady_clock::now();
    changed_.notify_all();
  }
}

void Alongside::got_on() {
  const std::lock_guard lock(mutex_);
  last_done_ = std::chrono::steady_clock::now();
}

void Alongside::reduce_next(Reduction& reduction, const std::stop_token& stop,
                            std::unique_lock<std::mutex>& lock) {
  const CapturedShot shot = std::move(queue_.front());
  queue_.pop_front();
  working_ = true;
  const bool judge = pose_wanted_;
  lock.unlock();
  if (judge) {
    const Result<PoseFit> pose = check_pose(rig_, prepared_, folder_, shot, stop);
    lock.lock();
    if (stop.stop_requested()) return;
    if (pose) {
      looks_.push_back(*pose);
      looked_at_.push_back(shot.name);
    } else {
      pose_failed_ = pose.error();
    }
    pose_wanted_ = pose && !opinion(looks_).decided;
    last_done_ = std::chrono::steady_clock::now();
    changed_.notify_all();
    lock.unlock();
  }
  Result<void> added = reduction.add(shot);
  std::optional<CurvePoint> point;
  std::optional<LightYield> yield;
  if (added) {
    point = reduction.estimate();
    if (reduction.trouble()) {
      added = tl::unexpected(*reduction.trouble());
      point.reset();
    }
  }
  if (point) {
    yield = yield_of(prepared_, shot.index, reduction.observations().back(),
                     rig_.camera.sensor.channels());
  }
  lock.lock();
  working_ = false;
  if (stop.stop_requested()) return;  // what was given up is no failure
  if (point) {
    latest_ = *point;
    // A held-out light makes the point before it known better.
    if (!curve_.empty() && curve_.back().lights == point->lights) curve_.pop_back();
    if (point->lights > 0) curve_.push_back(*point);
    yields_.push_back(std::move(*yield));
  } else if (!failed_) {
    failed_ = true;
    problem_ = shot.name + ": " + added.error().message;
  }
}

void Alongside::answer(std::unique_lock<std::mutex>& lock) {
  const ReplanQuestion question = *question_;
  working_ = true;
  lock.unlock();
  // yields_ is this thread's to change.
  std::optional<Answer> found;
  if (yields_.size() >= question.yields) {
    if (auto changes = lightrig::replan(prepared_, spec_, yields_, question, 1)) {
      found = Answer{yields_[question.yields - 1], std::move(*changes)};
    }
  }
  lock.lock();
  working_ = false;
  answer_ = std::move(found);
  question_.reset();
}

}  // namespace lightrig
