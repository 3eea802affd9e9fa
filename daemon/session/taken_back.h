#pragma once

#include <string>
#include <vector>

#include "daemon/session/journal.h"
#include "daemon/session/session_folder.h"

namespace lightrig {

/// Shots that were taken back (`retake`) and not captured since, by name: a result that is there
/// stands on what they were. None where the journal does not make sense, which is for others to
/// say.
std::vector<std::string> taken_back(const std::vector<JournalEvent>& events);
std::vector<std::string> taken_back(const SessionFolder& folder);

}  // namespace lightrig
