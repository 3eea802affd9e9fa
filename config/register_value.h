#pragma once

#include <cstdint>

#include "config/controller_profile.h"

namespace lightrig {

/// The raw number that an item's registers hold, in the order of their addresses; the second counts
/// only for types of 32 bits.
inline std::int64_t raw_of(const RegisterItem& item, std::uint16_t first, std::uint16_t second) {
  if (item.registers() == 1)
    return item.type == RawType::s16 ? static_cast<std::int16_t>(first) : first;
  const bool high_first = item.order == WordOrder::high_first;
  const std::uint32_t bits =
      (std::uint32_t{high_first ? first : second} << 16) | (high_first ? second : first);
  if (item.type == RawType::s32) return static_cast<std::int32_t>(bits);
  return bits;
}

/// And what that is in the item's unit.
inline double value_of_raw(const RegisterItem& item, std::int64_t raw) {
  return (static_cast<double>(raw) - item.offset) / item.scale;
}

}  // namespace lightrig
