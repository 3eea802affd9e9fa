#include "daemon/session/capture_time.h"

#include <algorithm>
#include <map>
#include <numeric>

#include "core/check.h"
#include "daemon/session/lay_candidates.h"
#include "daemon/session/plan_shots.h"

namespace lightrig {

namespace {

/// The lamp's ways from place to place, around what stands in them, each found once.
class Ways {
 public:
  Ways(const Rig& rig, const Mesh* object)
      : rig_(rig), object_(object), obstacles_(obstacles_of(rig, object)) {}

  /// Stops on the way, the last of them `to`; none where there is no way.
  const std::vector<GantryPosition>& between(const GantryPosition& from, const GantryPosition& to) {
    std::vector<double> ends(from.axes.begin(), from.axes.end());
    ends.insert(ends.end(), to.axes.begin(), to.axes.end());
    const auto known = known_.find(ends);
    if (known != known_.end()) return known->second;
    return known_.emplace(std::move(ends), found(from, to)).first->second;
  }

 private:
  std::vector<GantryPosition> found(const GantryPosition& from, const GantryPosition& to) {
    if (obstacle_on_the_way(rig_, obstacles_, from, to).empty()) return {to};
    if (candidates_.empty()) candidates_ = lay_candidates(rig_, object_).candidates;
    return clear_way(rig_, obstacles_, candidates_, from, to)
        .value_or(std::vector<GantryPosition>{});
  }

  const Rig& rig_;
  const Mesh* object_;
  const Obstacles obstacles_;
  std::vector<Candidate> candidates_;  // laid when first needed
  std::map<std::vector<double>, std::vector<GantryPosition>> known_;
};

CaptureTime time_by(Ways& ways, const Rig& rig, const SessionSpec& spec, const Plan& plan) {
  const auto frames = [&](const std::vector<double>& exposures) {
    return std::accumulate(exposures.begin(), exposures.end(), 0.0) +
           rig.camera.readout_time * static_cast<double>(exposures.size());
  };
  const GantryModel& gantry = rig.gantry.model;
  CaptureTime time;
  time.dark = frames(spec.bracket.exposures);
  GantryPosition at = home_position(gantry);
  for (const int index : plan.visit_order) {
    const Shot& shot = plan.shots[static_cast<std::size_t>(index)];
    ShotTime step;
    step.shot = index;
    step.way = ways.between(at, shot.gantry);
    for (const GantryPosition& stop : step.way) {
      step.move += move_time(gantry, at, stop);
      at = stop;
    }
    if (step.way.empty()) step.move = move_time(gantry, at, shot.gantry);
    step.settle = gantry.settle_time;
    step.warm_up = rig.lamp.warm_up;
    // The metering frame is one of the bracket's.
    step.exposures = frames(shot.exposures) + frames({shot.exposures.back()});
    time.shots.push_back(std::move(step));
    at = shot.gantry;
  }
  return time;
}

}  // namespace

double metering_exposure(const std::vector<double>& offered) {
  CHECK(!offered.empty());
  return offered[(offered.size() - 1) / 2];
}

double CaptureTime::total() const {
  return std::accumulate(shots.begin(), shots.end(), dark,
                         [](double sum, const ShotTime& shot) { return sum + shot.total(); });
}

CaptureTime capture_time(const Rig& rig, const SessionSpec& spec, const Plan& plan,
                         const Mesh* object) {
  Ways ways(rig, object);
  return time_by(ways, rig, spec, plan);
}

std::vector<double> capture_time_by_lights(const Rig& rig, const SessionSpec& spec,
                                           const Plan& plan, const Mesh* object) {
  Ways ways(rig, object);
  std::vector<Shot> fitted, held_out;
  for (const Shot& shot : plan.shots) (shot.held_out ? held_out : fitted).push_back(shot);
  std::vector<double> seconds;
  for (std::size_t n = 1; n <= fitted.size(); ++n) {
    Plan part;
    part.shots.assign(fitted.begin(), fitted.begin() + static_cast<std::ptrdiff_t>(n));
    part.shots.insert(part.shots.end(), held_out.begin(), held_out.end());
    part.visit_order = visiting_order(rig, spec, part);
    seconds.push_back(time_by(ways, rig, spec, part).total());
  }
  return seconds;
}

std::vector<AxisRange> axis_ranges(const GantryModel& gantry, const CaptureTime& time) {
  std::vector<AxisRange> ranges;
  for (const Axis& axis : gantry.axes) ranges.push_back({axis.home, axis.home});
  for (const ShotTime& step : time.shots) {
    for (const GantryPosition& stop : step.way) {
      for (std::size_t a = 0; a < ranges.size(); ++a) {
        const double value = stop.axes[static_cast<Eigen::Index>(a)];
        ranges[a] = {std::min(ranges[a].least, value), std::max(ranges[a].most, value)};
      }
    }
  }
  return ranges;
}

SessionSize largest_session(const Rig& rig, const SessionSpec& spec, const Plan& plan) {
  SessionSize size;
  size.frames = static_cast<std::int64_t>(spec.bracket.exposures.size());
  for (const Shot& shot : plan.shots)
    size.frames += static_cast<std::int64_t>(shot.exposures.size()) + 1;
  const double sites = static_cast<double>(rig.camera.model.width) * rig.camera.model.height;
  size.bytes = sites * (2.0 * static_cast<double>(size.frames) +
                        12.0 * static_cast<double>(plan.shots.size()));
  return size;
}

}  // namespace lightrig
