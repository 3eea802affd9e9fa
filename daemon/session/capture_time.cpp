#include "daemon/session/capture_time.h"

#include <numeric>

#include "core/check.h"
#include "daemon/session/lay_candidates.h"

namespace lightrig {

namespace {

/// The lamp's way from place to place, around what stands in it.
class Ways {
 public:
  explicit Ways(const Rig& rig) : rig_(rig), obstacles_(obstacles_of(rig, nullptr)) {}

  /// [s]; the direct way's where no way is found: the capture itself will say so.
  double time(const GantryPosition& from, const GantryPosition& to) {
    const GantryModel& gantry = rig_.gantry.model;
    if (obstacle_on_the_way(rig_, obstacles_, from, to).empty()) return move_time(gantry, from, to);
    if (candidates_.empty()) candidates_ = lay_candidates(rig_).candidates;
    const auto way = clear_way(rig_, obstacles_, candidates_, from, to);
    if (!way) return move_time(gantry, from, to);
    double sum = 0;
    const GantryPosition* at = &from;
    for (const GantryPosition& stop : *way) {
      sum += move_time(gantry, *at, stop);
      at = &stop;
    }
    return sum;
  }

 private:
  const Rig& rig_;
  const Obstacles obstacles_;
  std::vector<Candidate> candidates_;  // laid when first needed
};

}  // namespace

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
  Ways ways(rig);
  GantryPosition at = home_position(rig.gantry.model);
  for (const int index : plan.visit_order) {
    const Shot& shot = plan.shots[static_cast<std::size_t>(index)];
    ShotTime step;
    step.shot = index;
    step.move = ways.time(at, shot.gantry);
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
