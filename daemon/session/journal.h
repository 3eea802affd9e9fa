#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <nlohmann/json.hpp>
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

/// Appends events durably: write, fsync; seq continues after the replayed ones.
class Journal {
 public:
  static Result<Journal> open(const std::filesystem::path& path);
  Journal(Journal&&) noexcept;
  Journal& operator=(Journal&&) noexcept;
  ~Journal();

  Result<JournalEvent> append(const std::string& event, nlohmann::ordered_json fields);
  const std::vector<JournalEvent>& replayed() const { return replayed_; }

 private:
  Journal() = default;
  int fd_ = -1;
  std::uint64_t next_ = 1;
  std::vector<JournalEvent> replayed_;
};

}  // namespace lightrig
