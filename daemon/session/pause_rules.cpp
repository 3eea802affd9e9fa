#include "daemon/session/pause_rules.h"

#include <numeric>

namespace lightrig {

Hold next(Hold state, const PauseRule& rule, double reading) {
  if (!(reading <= rule.pause_above)) return Hold::held;
  if (reading <= rule.resume_below) return Hold::none;
  return state;
}

bool may_go_on(const PauseRule& rule, double reading, bool word) {
  if (word) return next(Hold::none, rule, reading) == Hold::none;
  return rule.resume_by_itself && next(Hold::held, rule, reading) == Hold::none;
}

void PacketWindow::add(const CameraCounters& now) {
  const std::uint64_t before = last_.packets_lost + last_.packets_resent;
  const std::uint64_t after = now.packets_lost + now.packets_resent;
  bad_.push_back(static_cast<double>(after >= before ? after - before : after));
  if (bad_.size() > size_) bad_.pop_front();
  last_ = now;
}

double PacketWindow::per_frame() const {
  if (bad_.empty()) return 0;
  return std::accumulate(bad_.begin(), bad_.end(), 0.0) / static_cast<double>(bad_.size());
}

}  // namespace lightrig
