#pragma once

#include <fmt/format.h>

#include "core/result.h"

namespace lightrig {

/// The choke point of every lamp driver: 0 to what the rig allows, and nothing else. Errors:
/// refused.
inline Result<void> allowed_power(double power, double most) {
  // Written so that what is not a number is refused.
  if (power >= 0 && power <= most) return {};
  return fail(ErrorCode::refused,
              fmt::format("lamp power {:.4g} is outside 0 to the rig's maximum of {:.4g}; nothing "
                          "was switched",
                          power, most));
}

}  // namespace lightrig
