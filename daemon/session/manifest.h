#pragma once

#include <filesystem>
#include <map>
#include <string>

#include "core/result.h"
#include "daemon/session/patience.h"
#include "daemon/session/session_folder.h"

namespace lightrig {

/// What manifest-sha256.txt says [RFC 8493]: SHA-256 by path relative to the session folder.
/// Errors: not_found, refused; invalid_input for a line that is not '<sha256>  <path>' or a path
/// that leads out of the folder, with its number.
Result<std::map<std::string, std::string>> read_manifest(const SessionFolder& folder);

/// After a sealed session was reduced again: the manifest's lines for radiance/ and result/ made
/// true to the files there; every other line stays as it was sealed. Does nothing for a session not
/// sealed. Beats with every file. Errors: those of read_manifest; no_space, refused.
Result<void> renew_results_in_manifest(const SessionFolder& folder, const Patience& patience = {});

}  // namespace lightrig
