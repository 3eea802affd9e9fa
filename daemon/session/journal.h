#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

#include "core/result.h"

namespace lightrig {

/// One line of journal.jsonl: {"seq":n,"event":"shot",…,"crc":"…"} where crc is over the line
/// without it.
struct JournalEvent {
  std::uint64_t sequence = 0;
  std::string
      event;  ///< opened, homed, dark, ambient, metering, shot, paused, resumed, retry, sealed, …
  nlohmann::ordered_json
      fields;  ///< facts; measured times under "measured", apart from what is compared
};

/// What replaying a journal found.
struct Replay {
  std::vector<JournalEvent> events;
  std::uint64_t good_bytes = 0;  ///< length of the valid prefix
  bool torn_tail = false;        ///< an incomplete last line was there: cut and reported
};

/// Reads a journal. Errors: invalid_input for damage anywhere but the tail, with the line number.
Result<Replay> replay_journal(const std::filesystem::path& path);

/// Appends events durably: write, fsync; seq continues after the replayed ones. One process at a
/// time: an open journal is locked.
class Journal {
 public:
  /// Creates or continues a journal; a torn tail is cut. Errors: those of replay_journal; refused
  /// when another process has it open or the system says no; no_space.
  static Result<Journal> open(const std::filesystem::path& path);
  Journal(Journal&&) noexcept;
  Journal& operator=(Journal&&) noexcept;
  ~Journal();

  /// Appends {"seq":…,"event":event, fields…}; durable when it returns. `fields` is an object or
  /// null, without the keys seq, event, crc. Errors: no_space, refused; the journal is then as it
  /// was before.
  Result<JournalEvent> append(const std::string& event, nlohmann::ordered_json fields);
  const std::vector<JournalEvent>& replayed() const { return replayed_; }
  std::uint64_t next_sequence() const { return next_; }
  bool torn_tail() const { return torn_tail_; }  ///< one was found and cut on opening

 private:
  Journal() = default;
  std::filesystem::path path_;
  int fd_ = -1;
  std::uint64_t next_ = 1;
  std::uint64_t bytes_ = 0;  ///< length of the valid file
  bool torn_tail_ = false;
  bool half_written_ = false;  ///< a line that could not be taken back stands behind bytes_
  std::vector<JournalEvent> replayed_;
};

}  // namespace lightrig
