#include "daemon/session/retry.h"

namespace lightrig {

Remedy RetryTally::next(ErrorCode code) {
  for (const RetryRule& rule : retry_rules) {
    if (rule.code != code) continue;
    const std::size_t n = failures_[code]++;
    if (n < rule.ladder.size()) return rule.ladder[n];
    return code == ErrorCode::no_space ? Remedy::wait_for_space : Remedy::give_up;
  }
  return Remedy::give_up;
}

}  // namespace lightrig
