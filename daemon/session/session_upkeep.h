#pragma once

#include <filesystem>
#include <set>
#include <string>
#include <vector>

#include "daemon/session/session_folder.h"

namespace lightrig {

/// Moves every file under frames/ that is not vouched for (paths relative to the session folder) to
/// rejected/SEQUENCE/…, so that nothing is deleted and no name is taken twice; the files moved,
/// sorted. Errors: no_space, refused.
Result<std::vector<std::string>> set_aside_frames(
    const SessionFolder& folder, const std::set<std::filesystem::path>& vouched_for,
    std::uint64_t sequence);

}  // namespace lightrig
