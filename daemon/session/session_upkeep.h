#pragma once

#include <filesystem>
#include <set>
#include <string>
#include <vector>

#include "config/file_descriptor.h"
#include "daemon/session/session_folder.h"

namespace lightrig {

/// Every regular file below a folder, relative to `root`, sorted; none where there is no folder.
/// Links are not followed. Errors: refused.
Result<std::vector<std::filesystem::path>> files_below(const std::filesystem::path& folder,
                                                       const std::filesystem::path& root);

/// Whether the session is captured, reduced and sealed, so that nothing of it is left to be done.
bool is_finished(const SessionFolder& folder);

/// Keeps others from capturing into the session, sealing or reducing it while the descriptor lives.
/// Errors: refused while somebody does.
Result<FileDescriptor> hold_folder(const SessionFolder& folder);

/// Moves every file under frames/ that is not vouched for (paths relative to the session folder) to
/// rejected/SEQUENCE/…, so that nothing is deleted and no name is taken twice; the files moved,
/// sorted. Errors: no_space, refused.
Result<std::vector<std::string>> set_aside_frames(
    const SessionFolder& folder, const std::set<std::filesystem::path>& vouched_for,
    std::uint64_t sequence);

}  // namespace lightrig
