// The twin of aravis/ for builds with LIGHTRIG_WITH_ARAVIS=OFF.
#include "drivers/backends.h"

namespace lightrig {
namespace {

constexpr const char* remedy =
    "this build leaves it out: install libaravis-dev and build with -DLIGHTRIG_WITH_ARAVIS=ON";

}  // namespace

Result<std::unique_ptr<Camera>> open_camera(const Rig&, const AravisCamera&, Clock&) {
  return fail(ErrorCode::not_built, std::string("GigE Vision camera: ") + remedy);
}

Result<std::vector<FoundCamera>> find_cameras() {
  return fail(ErrorCode::not_built, std::string("GigE Vision cameras: ") + remedy);
}

Backend aravis_backend() { return {"aravis", false, remedy}; }

}  // namespace lightrig
