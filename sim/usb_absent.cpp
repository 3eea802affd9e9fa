// The twin of usb/ for builds with LIGHTRIG_WITH_USB=OFF.
#include "sim/hosted_wire.h"

namespace lightrig::sim {

namespace {

tl::unexpected<Error> absent() {
  return fail(
      ErrorCode::not_built,
      "simulated GRBL controller: this build leaves it out: install libusb-1.0-0-dev and build "
      "with -DLIGHTRIG_WITH_USB=ON");
}

}  // namespace

Result<std::vector<HostedWire>> host_wire(const Rig&, const GrblGantry&, std::shared_ptr<World>,
                                          std::shared_ptr<WireFaults>) {
  return absent();
}
Result<std::vector<HostedWire>> host_wire(const Rig&, const GrblLamp&, std::shared_ptr<World>,
                                          std::shared_ptr<WireFaults>) {
  return absent();
}

}  // namespace lightrig::sim
