// The twin of panel/ for builds with LIGHTRIG_WITH_PANEL=OFF.
#include "daemon/service/api.h"

namespace lightrig {

Result<std::string> panel_page() {
  return fail(ErrorCode::not_built,
              "operator panel: this build leaves it out; build with -DLIGHTRIG_WITH_PANEL=ON, or "
              "use the lightrig command");
}

}  // namespace lightrig
