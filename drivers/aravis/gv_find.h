#pragma once

#include "config/rig.h"
#include "core/result.h"
#include "drivers/aravis/gv_ref.h"

namespace lightrig {

/// The camera that the rig file names by address, by Aravis id or by serial number, opened. By
/// address nothing is searched for; `interface_ip` says which of the host's networks to use.
/// Errors: not_found (with what there is), refused (several cameras fit), invalid_input.
Result<GRef<ArvCamera>> find_camera(const AravisCamera& backend);

}  // namespace lightrig
