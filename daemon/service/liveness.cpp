#include "daemon/service/liveness.h"

namespace lightrig {

void Liveness::promise(std::chrono::milliseconds within) {
  until_ = (SteadyClock::now() + within).time_since_epoch().count();
}

bool Liveness::holds(SteadyClock::time_point now) const {
  return now.time_since_epoch().count() <= until_;
}

}  // namespace lightrig
