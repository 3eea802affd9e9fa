#include "daemon/session/taken_back.h"

#include <algorithm>

namespace lightrig {

std::vector<std::string> taken_back(const std::vector<JournalEvent>& events) {
  const auto captured = captured_of(events);
  std::vector<std::string> open;
  if (!captured) return open;
  for (const auto& [name, times] : captured->retakes)
    if (std::ranges::find(captured->shots, name, &CapturedShot::name) == captured->shots.end())
      open.push_back(name);
  return open;
}

std::vector<std::string> taken_back(const SessionFolder& folder) {
  const auto journal = replay_journal(folder.journal());
  return journal ? taken_back(journal->events) : std::vector<std::string>();
}

}  // namespace lightrig
