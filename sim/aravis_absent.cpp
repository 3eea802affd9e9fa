// The twin of aravis/ for builds with LIGHTRIG_WITH_ARAVIS=OFF.
#include "sim/hosted_wire.h"

namespace lightrig::sim {

Result<std::vector<HostedWire>> host_wire(const Rig&, const AravisCamera&, std::shared_ptr<World>,
                                          std::shared_ptr<CameraWireFaults>) {
  return fail(ErrorCode::not_built,
              "simulated GigE Vision camera: this build leaves it out: install libaravis-dev and "
              "build with -DLIGHTRIG_WITH_ARAVIS=ON");
}

}  // namespace lightrig::sim
