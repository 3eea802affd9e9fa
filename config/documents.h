#pragma once

#include <optional>
#include <string>
#include <vector>

#include "config/section.h"

namespace lightrig {

/// A document met by its description; empty, with the reason among the findings, when there is
/// nothing to meet: not TOML, or no key at all. `needs` says what an empty file lacks.
std::optional<Section> read_document(const Source& source, const TableSpec& description,
                                     const std::string& needs, Findings& findings);

/// Every table of a session: from the session file (nullptr: there is none) where it has it, else
/// from the rig file, else by default. [object] and [bracket] have no default; where they are
/// missing `said_in` is blamed.
std::vector<const Section*> effective_tables(const Section* session, const Section& rig,
                                             const Source& said_in, Findings& findings);

}  // namespace lightrig
