#include "cli/panel_backend.h"

namespace lightrig::cli {

Backend panel_backend() { return {"panel", true, ""}; }

}  // namespace lightrig::cli
