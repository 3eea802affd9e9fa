#pragma once

#include <vector>

#include "config/key_spec.h"

namespace lightrig {

/// Every table and key of a rig file, a session file and a controller profile. The reader, `check
/// --print`, docs/rig_file.md, docs/controller_profile.md and docs/rig.schema.json come from these.
const TableSpec& rig_description();
const TableSpec& session_description();
const TableSpec& profile_description();

// Parts of the above, a file each.
TableSpec camera_table();
TableSpec gantry_table();
TableSpec lamp_table();
std::vector<TableSpec> session_tables();  ///< [object] … [session]; a rig file may hold them too

/// host, port | device, baud, …: how a Modbus unit is reached; give `endpoint_choice` too.
std::vector<KeySpec> endpoint_keys();
/// baud, parity, …, legal only beside `device`; without defaults where a profile gives them.
std::vector<KeySpec> serial_keys();

}  // namespace lightrig
