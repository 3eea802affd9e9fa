// The twin of panel/ for builds with LIGHTRIG_WITH_PANEL=OFF.
#include "cli/panel_backend.h"

namespace lightrig::cli {

Backend panel_backend() {
  return {"panel", false,
          "this build leaves the operator panel out; build with -DLIGHTRIG_WITH_PANEL=ON"};
}

}  // namespace lightrig::cli
