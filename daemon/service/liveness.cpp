#include "daemon/service/liveness.h"

namespace lightrig {

void Liveness::promise(std::chrono::milliseconds within) {
  until_ = (now_() + within).time_since_epoch().count();
}

bool Liveness::holds(SteadyClock::time_point at) const {
  return at.time_since_epoch().count() <= until_;
}

}  // namespace lightrig
