#pragma once

#include <filesystem>
#include <optional>
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

/// Whether the files that a rig or session names (profile, mesh, materials, reference) must be
/// there. They must before a capture; a stored session brings its own copies of what it needs.
enum class NamedFiles : std::uint8_t { must_exist, may_be_absent };

/// Reads and validates a rig file [docs/rig_file.md]. Touches no device. session_defaults is
/// complete only where the rig file holds [object] and [bracket]; read_session() tells.
Read<Rig> read_rig(const std::filesystem::path& path, NamedFiles named = NamedFiles::must_exist);
/// The same of bytes that are, or were, the contents of `path`; paths in it are relative to that.
Read<Rig> read_rig_text(std::string text, const std::filesystem::path& path,
                        NamedFiles named = NamedFiles::must_exist);

/// Reads a session file over the rig's session defaults; the result is complete and valid for this
/// rig. A table in the session file replaces the rig file's whole table. An empty path means that
/// there is no session file: the rig file must hold all that a session needs.
Read<SessionSpec> read_session(const std::filesystem::path& path, const Rig& rig,
                               NamedFiles named = NamedFiles::must_exist);
Read<SessionSpec> read_session_text(std::string text, const std::filesystem::path& path,
                                    const Rig& rig, NamedFiles named = NamedFiles::must_exist);

/// Effective values and where each came from, for `check --print`; one "table.key = value  #
/// file:line or default".
std::vector<std::string> effective_values(const Rig& rig, const SessionSpec& spec);

}  // namespace lightrig
