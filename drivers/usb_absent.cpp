// The twin of usb/ for builds with LIGHTRIG_WITH_USB=OFF.
#include "drivers/backends.h"

namespace lightrig {
namespace {

constexpr const char* remedy =
    "this build leaves it out: install libusb-1.0-0-dev and build with -DLIGHTRIG_WITH_USB=ON";

}  // namespace

Result<GantryAndLamp> open_gantry(const Rig&, const GrblGantry&, Clock&) {
  return fail(ErrorCode::not_built, std::string("GRBL gantry: ") + remedy);
}

Result<std::unique_ptr<Lamp>> open_lamp(const Rig&, const GrblLamp&, Clock&) {
  return fail(ErrorCode::not_built, std::string("GRBL lamp: ") + remedy);
}

Backend usb_backend() { return {"usb", false, remedy}; }

}  // namespace lightrig
