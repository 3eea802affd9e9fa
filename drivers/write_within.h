#pragma once

#include <chrono>
#include <cstddef>
#include <string>
#include <string_view>

#include "core/result.h"

namespace lightrig {

/// Hands over all bytes with one patience for the whole, however little each transfer takes.
/// `transfer(rest, milliseconds)` gives how many it took, which may be none. Errors: the transfer's
/// own, timed_out.
template <class Transfer>
Result<void> write_within(std::string_view bytes, std::chrono::milliseconds patience,
                          const std::string& name, const Transfer& transfer) {
  using std::chrono::steady_clock;
  const auto end = steady_clock::now() + patience;
  while (!bytes.empty()) {
    const auto left =
        std::chrono::duration_cast<std::chrono::milliseconds>(end - steady_clock::now());
    if (left.count() <= 0)
      return fail(ErrorCode::timed_out, name + ": write: " + std::to_string(bytes.size()) +
                                            " bytes are not taken in time");
    const Result<std::size_t> taken = transfer(bytes, left);
    if (!taken) return tl::unexpected(taken.error());
    bytes.remove_prefix(*taken);
  }
  return {};
}

}  // namespace lightrig
