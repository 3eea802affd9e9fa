#pragma once

#include <string>

#include "core/plan.h"

namespace lightrig::cli {

/// What the scene did not need, one line each, with what was needed beside it.
std::string left_out_table(const LeftOut& left_out);

}  // namespace lightrig::cli
