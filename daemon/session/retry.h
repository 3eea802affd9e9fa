#pragma once

#include <array>
#include <cstdint>
#include <map>

#include "core/result.h"

namespace lightrig {

/// What to do about a failed step of a session.
enum class Remedy : std::uint8_t {
  again,   ///< look at the rig's status, then do the whole step anew
  reopen,  ///< destroy the devices, open them (several tries), look at the status, do the step anew
  mend,    ///< do it anew only if the status names a cause that can be put right
  wait_for_space,  ///< pause until the disk has room
  give_up,
};

/// The retry policy, all of it: what is tried at the first, second and third failure of one step
/// with the same code; beyond that it is given up. A step is never repeated blindly: the gantry's
/// status is read first, whatever the remedy.
struct RetryRule {
  ErrorCode code;
  std::array<Remedy, 3> ladder;
};
inline constexpr std::array<RetryRule, 8> retry_rules{{
    {ErrorCode::invalid_input, {Remedy::give_up, Remedy::give_up, Remedy::give_up}},
    {ErrorCode::not_built, {Remedy::give_up, Remedy::give_up, Remedy::give_up}},
    {ErrorCode::not_found, {Remedy::reopen, Remedy::give_up, Remedy::give_up}},
    {ErrorCode::disconnected, {Remedy::reopen, Remedy::reopen, Remedy::give_up}},
    {ErrorCode::timed_out, {Remedy::again, Remedy::again, Remedy::reopen}},
    {ErrorCode::refused, {Remedy::mend, Remedy::mend, Remedy::give_up}},
    {ErrorCode::stopped, {Remedy::give_up, Remedy::give_up, Remedy::give_up}},
    {ErrorCode::no_space, {Remedy::wait_for_space, Remedy::wait_for_space, Remedy::wait_for_space}},
}};

/// Failures of one step so far, by code.
class RetryTally {
 public:
  /// Counts a failure and says what to do about it.
  Remedy next(ErrorCode code);

 private:
  std::map<ErrorCode, std::size_t> failures_;
};

}  // namespace lightrig
