#pragma once

#include <filesystem>
#include <string>

#include "core/brdf_error.h"
#include "core/result.h"

namespace lightrig {

/// A BRDF from a .binary file, or from a session folder's result.
Result<BrdfTable> load_brdf(const std::filesystem::path& file_or_session);

struct VerifyReport {
  bool sound = false;
  std::vector<std::string> findings;  ///< one line each, what is wrong and where; empty when sound
  std::string summary;
};
/// Checks a session folder: every checksum of the manifest, the journal, and the reduction
/// reproduced (equal bytes, or 1e-6 relative on another build).
Result<VerifyReport> verify_session(const std::filesystem::path& session, int threads);

}  // namespace lightrig
