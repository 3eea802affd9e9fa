#pragma once

#include <condition_variable>
#include <cstddef>
#include <deque>
#include <mutex>
#include <optional>
#include <stop_token>
#include <string>
#include <thread>
#include <vector>

#include "core/image.h"
#include "daemon/session/session_folder.h"

namespace lightrig {

/// A frame in hand, not yet on disk.
struct TakenFrame {
  Frame frame;
  std::string file;      ///< relative to the session folder
  std::string role;      ///< as StoredFrame::role
  double asked = 0;      ///< [s] exposure asked for
  std::string taken_at;  ///< UTC, ISO 8601
};

/// Stores the frames of one shot at a time on a thread of its own. A frame is encoded while the
/// next one is exposed; the disk sees none of it before the shot is whole and begin() says so, and
/// then storing overlaps the next move. A shot whose storing failed stays in hand until it is
/// stored: nothing taken is lost to a full disk. Destroying it ends the thread, after the shot in
/// hand.
class FrameStore {
 public:
  FrameStore(SessionFolder folder, SensorModel sensor);
  ~FrameStore();
  FrameStore(const FrameStore&) = delete;
  FrameStore& operator=(const FrameStore&) = delete;

  /// Hands over a frame of the shot being taken. The shot before must have been collected.
  void add(TakenFrame frame);
  /// The frame added last, until the shot is collected or dropped.
  const TakenFrame& last() const { return frames_.back(); }
  /// The shot being taken is thrown away.
  void drop();

  /// The shot is whole: begins to store its frames.
  void begin();

  /// Waits until the frames are stored; what they are now called. Errors: those of write_durably,
  /// or stopped; the frames then stay in hand, and collecting again tries again.
  Result<std::vector<StoredFrame>> collect(const std::stop_token& stop);

  /// The frames in hand, for previews; valid between begin() and a successful collect().
  const std::deque<TakenFrame>& in_hand() const { return frames_; }

 private:
  using Encoded = Result<std::vector<std::byte>>;

  void run(const std::stop_token& stop);
  Result<std::vector<StoredFrame>> store() const;

  SessionFolder folder_;
  SensorModel sensor_;
  mutable std::mutex mutex_;
  std::condition_variable_any changed_;
  // Added to by add(), cleared while the thread is idle: it reads elements without the lock, which
  // a deque does not move.
  std::deque<TakenFrame> frames_;
  std::deque<Encoded> encoded_;  ///< of the first of them; written by the thread
  bool busy_ = false;            ///< the thread is at an element
  bool storing_ = false;
  std::optional<Result<std::vector<StoredFrame>>> outcome_;
  std::jthread thread_;  ///< last: it uses all of the above
};

/// "2026-11-22T03:15:00.123Z".
std::string utc_now();

}  // namespace lightrig
