#pragma once

#include <string>
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

TableSpec axis_table();  ///< [[gantry.axis]]
TableSpec body_table();  ///< [gantry.body]

/// Names that axes may have.
std::vector<std::string> rotary_axes();
std::vector<std::string> linear_axes();
std::vector<std::string> axis_names();

/// A key of a rotary axis and the same of a linear one, told apart by the axis' name in `name_key`.
std::vector<KeySpec> both_units(const std::string& name_key, const KeySpec& rotary,
                                const std::string& linear_name, const Unit& linear_unit,
                                const Range& linear_range);

/// host, port | device, baud, …: how a Modbus unit is reached; give `endpoint_choice` too.
std::vector<KeySpec> endpoint_keys();
/// How long one answer of a wire may take.
KeySpec timeout_key(const char* fallback);
/// usb_vendor, … | device, baud: how a GRBL controller is reached; exactly one of usb_vendor and
/// device.
std::vector<KeySpec> grbl_endpoint_keys();
/// baud, parity, …, legal only beside `device`; without defaults where a profile gives them.
std::vector<KeySpec> serial_keys();

}  // namespace lightrig
