#pragma once

#include <cstdint>
#include <deque>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <span>
#include <string>
#include <vector>

namespace lightrig {

/// What the service tells whoever listens, as server-sent events. Journal events carry their
/// sequence as id and are replayed to a late or returning reader; everything else ("state",
/// "progress", …) is a value of which a reader gets the newest when it is ready to read. So a slow
/// reader costs one position and at most one event of memory, and publishing never waits for it.
class EventHub {
 public:
  /// Events of one session kept for replay; older ones are in the session's own journal.jsonl.
  static constexpr std::size_t history_limit = 20000;

  /// One reader. Used by one thread at a time; outlived by its hub.
  class Reader {
   public:
    ~Reader();
    Reader(const Reader&) = delete;
    Reader& operator=(const Reader&) = delete;

    /// Fills `out` with the next bytes of the stream; how many, 0 when the reader has been put to
    /// sleep because there is nothing to say, empty when the stream has ended.
    std::optional<std::size_t> read(std::span<char> out);

   private:
    friend class EventHub;
    Reader(EventHub& hub, std::function<void()> sleep, std::function<void()> wake)
        : hub_(hub), sleep_(std::move(sleep)), wake_(std::move(wake)) {}
    bool compose();

    EventHub& hub_;
    std::function<void()> sleep_, wake_;  ///< called under the hub's lock
    std::string pending_;                 ///< composed and not yet read
    std::uint64_t epoch_ = 0;             ///< session of `after_`
    std::uint64_t after_ = 0;             ///< last journal sequence composed
    std::map<std::string, std::uint64_t> seen_;
    bool asleep_ = false, heartbeat_due_ = true;
  };

  /// A session's journal begins: the history, progress and preview of the one before are dropped.
  /// The session that is there already goes on, and so does every reader where it is.
  void begin_session(const std::string& id);

  /// One journal event: `sequence` ascending, `json` one line. One that was published before is not
  /// published again.
  void publish(std::uint64_t sequence, const std::string& event, const std::string& json);

  /// The same from outside the session's own run: nothing where readers are told of another.
  void publish_of(const std::string& session, std::uint64_t sequence, const std::string& event,
                  const std::string& json);

  /// The newest value of `name`; `json` one line.
  void update(const std::string& name, std::string json);

  /// Sends every reader a comment, so that dead ones are noticed.
  void heartbeat();

  /// Ends every stream; later readers end at once.
  void close();

  /// A reader that has seen journal event `after` of `session` already (other sessions count
  /// nothing, "" means the present one). `sleep` is called when there is nothing to say, `wake`
  /// when there is again; both under a lock and must only take note.
  std::unique_ptr<Reader> subscribe(const std::string& session, std::uint64_t after,
                                    std::function<void()> sleep, std::function<void()> wake);

  std::size_t readers() const;

 private:
  struct Entry {
    std::uint64_t sequence;
    std::string text;
  };
  struct Value {
    std::uint64_t version;
    std::string text;
  };
  void append(std::uint64_t sequence, const std::string& event, const std::string& json);
  void wake_all();

  mutable std::mutex mutex_;
  std::string session_;
  std::uint64_t epoch_ = 0, version_ = 0;
  std::deque<Entry> history_;
  std::map<std::string, Value> values_;
  std::vector<Reader*> readers_;
  bool closed_ = false;
};

}  // namespace lightrig
