#pragma once

#include <string>

#include "config/key_spec.h"

namespace lightrig {

/// Every table and key of a kind of file as Markdown, a table each: what docs/rig_file.md and
/// docs/controller_profile.md hold between their markers.
std::string key_reference(const TableSpec& root);

/// The same as a JSON schema (draft 07), for editors: types, ranges, choices, what goes with what.
/// What takes more than one key to judge is left to `lightrig check`.
std::string json_schema(const TableSpec& root, const std::string& title);

}  // namespace lightrig
