#pragma once

#include <string>
#include <vector>

#include "daemon/session/left_out.h"

namespace lightrig::cli {

/// What the scene did not need, one line each, "left out | of"; then the drivers.
std::string left_out_table(const std::vector<LeftOutLine>& lines,
                           const std::vector<std::string>& drivers_not_opened);

}  // namespace lightrig::cli
