#pragma once

#include "config/rig.h"
#include "core/result.h"
#include "drivers/aravis/gv_ref.h"

namespace lightrig {

/// Whether this process may receive as the rig file asks: the kernel's ceiling on socket buffers
/// for UDP, CAP_NET_RAW for a packet socket. Errors: refused, with the command that mends it.
Result<void> check_receiving(const AravisCamera& backend);

/// Sets the size of stream packets: the rig file's, once it is known to arrive, or the largest that
/// does. Errors: refused (the network does not carry it).
Result<void> choose_packet_size(ArvCamera* camera, const AravisCamera& backend);

}  // namespace lightrig
