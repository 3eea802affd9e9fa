#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "config/diagnostic.h"
#include "config/rig.h"

namespace lightrig {

/// A value together with what was said about the file it came from. Warnings may stand beside a
/// valid value.
template <class T>
struct Read {
  std::optional<T> value;               ///< present iff there is no error among the diagnostics
  std::vector<Diagnostic> diagnostics;  ///< all of them at once
  std::string text;                     ///< the file's bytes
};

/// Reads and validates a rig file [docs/rig_file.md]. Touches no device.
Read<Rig> read_rig(const std::filesystem::path& path);

/// Reads a session file over the rig's session defaults; the result is complete and valid for this
/// rig.
Read<SessionSpec> read_session(const std::filesystem::path& path, const Rig& rig);

/// Effective values and where each came from, for `check --print`; one "table.key = value  #
/// file:line or default".
std::vector<std::string> effective_values(const Rig& rig, const SessionSpec& spec);

}  // namespace lightrig
