#include "study/rig_time.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "config/read_rig.h"
#include "core/route.h"
#include "daemon/session/capture_time.h"
#include "daemon/session/lay_candidates.h"

namespace lightrig {
namespace {

/// Study directions are seen from the camera: its view runs along −z with y up.
Eigen::Vector3d in_rig(const Rig& rig, const Eigen::Vector3d& direction) {
  const Eigen::Vector3d in_camera(direction.x(), -direction.y(), -direction.z());
  return rig.camera.model.camera_from_world.linear().transpose() * in_camera;
}

}  // namespace

Result<RigTime> RigTime::open(const std::filesystem::path& rig_file,
                              std::span<const LightPosition> directions) {
  RigTime out;
  const Read<Rig> rig = read_rig(rig_file);
  if (rig.value) out.rig_ = *rig.value;
  const Read<SessionSpec> session = rig.value ? read_session("", out.rig_) : Read<SessionSpec>{};
  if (!session.value) {
    return fail(ErrorCode::invalid_input,
                fmt::format("study: rig {}: no valid rig file with a session's tables in it; "
                            "lightrig check {} says what is wrong",
                            rig_file.string(), rig_file.string()));
  }
  out.session_ = *session.value;
  const CandidateLayout layout = lay_candidates(out.rig_);
  if (layout.candidates.empty()) {
    return fail(ErrorCode::invalid_input,
                fmt::format("study: rig {}: the gantry reaches none of its {} candidates",
                            rig_file.string(), layout.offered));
  }
  const Eigen::Vector3d centre = out.session_.object.world_from_object.translation();
  std::vector<Eigen::Vector3d> offered;
  for (const Candidate& c : layout.candidates) offered.push_back(c.light.direction_from(centre));
  std::vector<double> apart;
  for (const LightPosition& light : directions) {
    const Eigen::Vector3d wanted = in_rig(out.rig_, light.p.normalized());
    std::size_t best = 0;
    for (std::size_t i = 1; i < offered.size(); ++i) {
      if (wanted.dot(offered[i]) > wanted.dot(offered[best])) best = i;
    }
    out.stop_.push_back(layout.candidates[best].gantry);
    apart.push_back(std::acos(std::clamp(wanted.dot(offered[best]), -1.0, 1.0)));
  }
  if (!apart.empty()) {
    const auto middle = apart.begin() + static_cast<std::ptrdiff_t>(apart.size() / 2);
    std::nth_element(apart.begin(), middle, apart.end());
    out.median_deviation_ = *middle;
  }
  return out;
}

double RigTime::seconds(std::span<const int> lights) const {
  std::vector<GantryPosition> stops;
  Plan plan;
  for (const int light : lights) {
    Shot shot;
    shot.gantry = stop_[static_cast<std::size_t>(light)];
    shot.exposures = session_.bracket.exposures;
    stops.push_back(shot.gantry);
    plan.shots.push_back(std::move(shot));
  }
  plan.visit_order = order_route(rig_.gantry.model, home_position(rig_.gantry.model), stops);
  return capture_time(rig_, session_, plan, nullptr).total();
}

}  // namespace lightrig
