#include "daemon/session/bin_views.h"

#include <map>
#include <span>
#include <utility>
#include <vector>

#include "core/pixel_neighbours.h"

namespace lightrig {
namespace {

/// Candidates by how the camera sees the object: on a turntable one group for every turn.
std::vector<std::vector<std::size_t>> candidates_by_view(const Rig& rig,
                                                         const std::vector<Candidate>& candidates) {
  std::map<double, std::vector<std::size_t>> views;
  const bool turns = turns_object(rig.gantry.model);
  for (std::size_t i = 0; i < candidates.size(); ++i)
    views[turns ? candidates[i].gantry.axes[0] : 0.0].push_back(i);
  std::vector<std::vector<std::size_t>> groups;
  for (auto& [turn, group] : views) groups.push_back(std::move(group));
  return groups;
}

}  // namespace

BinningResult bin_views(const Rig& rig, const SessionSpec& spec, const Prepared& prepared,
                        ShadowRays shadows, int threads, const Patience& patience) {
  const BrdfBasis& basis = prepared.plan_basis;
  std::vector<std::span<const std::int32_t>> cells(prepared.candidates.size());
  std::vector<BinningResult> parts;
  const auto groups = candidates_by_view(rig, prepared.candidates);
  parts.reserve(groups.size());  // spans point into them
  for (const std::vector<std::size_t>& group : groups) {
    std::vector<LightPosition> lights;
    for (const std::size_t i : group) lights.push_back(prepared.candidates[i].light);
    SurfacePoints turned;
    if (turns_object(rig.gantry.model))
      turned = points_seen(rig, spec, prepared, prepared.candidates[group.front()].gantry);
    const SurfacePoints& seen = turns_object(rig.gantry.model) ? turned : prepared.points;
    // Extraction passes over pixels that mix radiances: a plan must not count on them.
    const CameraModel& camera = rig.camera.model;
    SurfacePoints whole;
    if (seen.from_pixels && seen.size() > 0)
      whole = PixelNeighbours(seen, camera.width, camera.height).whole_points();
    parts.push_back(bin_candidates(whole.size() > 0 ? whole : seen, lights, basis.grid, basis.valid,
                                   spec.plan.limits, *prepared.occluder, shadows, threads));
    for (std::size_t k = 0; k < group.size(); ++k)
      cells[group[k]] = parts.back().bins.of(static_cast<int>(k));
    patience.tell();
  }
  if (parts.size() == 1) return std::move(parts.front());
  BinningResult whole;
  whole.bins.grid = basis.grid;
  whole.bins.offset.push_back(0);
  for (const std::span<const std::int32_t> of_one : cells) {
    whole.bins.cell.insert(whole.bins.cell.end(), of_one.begin(), of_one.end());
    whole.bins.offset.push_back(static_cast<std::int64_t>(whole.bins.cell.size()));
  }
  for (const BinningResult& part : parts) whole.statistics.add(part.statistics);
  whole.statistics.convex = prepared.occluder->convex();
  return whole;
}

}  // namespace lightrig
