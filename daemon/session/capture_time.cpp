#include "daemon/session/capture_time.h"

#include <numeric>

#include "core/check.h"
#include "daemon/session/lay_candidates.h"

namespace lightrig {

double metering_exposure(const std::vector<double>& offered) {
  CHECK(!offered.empty());
  return offered[(offered.size() - 1) / 2];
}

double CaptureTime::total() const {
  return std::accumulate(shots.begin(), shots.end(), dark,
                         [](double sum, const ShotTime& shot) { return sum + shot.total(); });
}

CaptureTime capture_time(const Rig& rig, const SessionSpec& spec, const Plan& plan) {
  const auto frames = [&](const std::vector<double>& exposures) {
    return std::accumulate(exposures.begin(), exposures.end(), 0.0) +
           rig.camera.readout_time * static_cast<double>(exposures.size());
  };
  CaptureTime time;
  time.dark = frames(spec.bracket.exposures);
  GantryPosition at = home_position(rig.gantry.model);
  for (const int index : plan.visit_order) {
    const Shot& shot = plan.shots[static_cast<std::size_t>(index)];
    ShotTime step;
    step.shot = index;
    step.move = move_time(rig.gantry.model, at, shot.gantry);
    step.settle = rig.gantry.model.settle_time;
    step.warm_up = rig.lamp.warm_up;
    // The metering frame is one of the bracket's.
    step.exposures = frames(shot.exposures) + frames({shot.exposures.back()});
    time.shots.push_back(step);
    at = shot.gantry;
  }
  return time;
}

}  // namespace lightrig
