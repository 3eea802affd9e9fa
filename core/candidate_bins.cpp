#include "core/candidate_bins.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include "core/cell_lookup.h"
#include "core/check.h"
#include "core/half_diff.h"
#include "core/parallel.h"

namespace lightrig {

namespace {

/// A lit, camera-facing point and the cell that one light shows there.
struct LitPoint {
  std::int32_t point, cell;
};

/// What every candidate has in common.
struct Setting {
  const SurfacePoints& points;
  std::span<const std::uint8_t> valid;
  CellLookup lookup;
  GrazingLimits limits;
  double max_tangent2;  ///< tan² of limits.max_theta_d
  const Occluder& occluder;
  ShadowRays rays;
  std::vector<std::int32_t> in_view;  ///< points within the camera's grazing limit
};

/// Memory that one worker uses again for every candidate.
struct Scratch {
  std::vector<LitPoint> lit;
  std::vector<std::uint8_t> filled;  ///< (cells)
  std::vector<std::int32_t> start;   ///< (cells + 1)
  std::vector<std::int32_t> sorted;  ///< lit points by cell
  std::vector<std::int32_t> open;    ///< cells that still look for an unblocked point
  std::vector<Eigen::Vector3d> position, normal;
  std::vector<std::uint8_t> blocked;
};

/// The lit points of one candidate, those without statistics included as cell −1 never: they are
/// dropped here.
void find_lit(const Setting& setting, const LightPosition& light, Scratch& scratch,
              BinningStatistics& statistics) {
  const SurfacePoints& points = setting.points;
  scratch.lit.clear();
  statistics.back_facing += points.size() - static_cast<Eigen::Index>(setting.in_view.size());
  for (const std::int32_t i : setting.in_view) {
    const Eigen::Vector3d n = points.normal.col(i);
    const Eigen::Vector3d v = points.view.col(i);
    const Eigen::Vector3d l = light.direction_from(points.position.col(i));
    const double cos_i = n.x() * l.x() + n.y() * l.y() + n.z() * l.z();
    if (!(cos_i > 0) || cos_i < setting.limits.min_cos_i) {
      ++statistics.back_facing;
      continue;
    }
    const Eigen::Vector3d sum = l + v;
    if (!(sum.squaredNorm() > 0)) {
      ++statistics.no_half_vector;
      continue;
    }
    if (difference_tangent2(l, v) > setting.max_tangent2) {
      ++statistics.back_facing;
      continue;
    }
    ++statistics.points_tested;
    const std::int32_t cell = setting.lookup(n, l, v);
    if (!setting.valid.empty() && setting.valid[static_cast<std::size_t>(cell)] == 0) continue;
    scratch.lit.push_back({i, cell});
  }
}

/// Shadow rays for the points named; scratch.blocked tells the outcome.
void cast(const Setting& setting, const LightPosition& light, std::span<const std::int32_t> point,
          Scratch& scratch, BinningStatistics& statistics) {
  scratch.position.clear();
  scratch.normal.clear();
  for (const std::int32_t i : point) {
    scratch.position.push_back(setting.points.position.col(i));
    scratch.normal.push_back(setting.points.normal.col(i));
  }
  scratch.blocked.assign(point.size(), 0);
  setting.occluder.blocked(scratch.position, scratch.normal, light, scratch.blocked);
  statistics.rays_cast += static_cast<std::int64_t>(point.size());
}

/// One ray per lit point: the plain reference.
void fill_by_all_rays(const Setting& setting, const LightPosition& light, Scratch& scratch,
                      BinningStatistics& statistics) {
  std::vector<std::int32_t> point;
  for (const LitPoint& lit : scratch.lit) point.push_back(lit.point);
  cast(setting, light, point, scratch, statistics);
  for (std::size_t k = 0; k < scratch.lit.size(); ++k) {
    if (scratch.blocked[k] == 0) {
      scratch.filled[static_cast<std::size_t>(scratch.lit[k].cell)] = 1;
    }
  }
}

/// Rounds of one ray per cell that has not shown an unblocked point yet.
void fill_by_needed_rays(const Setting& setting, const LightPosition& light, Scratch& scratch,
                         BinningStatistics& statistics) {
  const auto cells = static_cast<std::size_t>(setting.lookup.grid().cells());
  scratch.start.assign(cells + 1, 0);
  for (const LitPoint& lit : scratch.lit) ++scratch.start[static_cast<std::size_t>(lit.cell) + 1];
  scratch.open.clear();
  for (std::size_t c = 0; c < cells; ++c) {
    if (scratch.start[c + 1] > 0) scratch.open.push_back(static_cast<std::int32_t>(c));
    scratch.start[c + 1] += scratch.start[c];
  }
  scratch.sorted.resize(scratch.lit.size());
  std::vector<std::int32_t> next(scratch.start.begin(), scratch.start.end() - 1);
  for (const LitPoint& lit : scratch.lit) {
    scratch.sorted[static_cast<std::size_t>(next[static_cast<std::size_t>(lit.cell)]++)] =
        lit.point;
  }
  std::copy(scratch.start.begin(), scratch.start.end() - 1, next.begin());
  std::vector<std::int32_t> point;
  while (!scratch.open.empty()) {
    point.clear();
    for (const std::int32_t c : scratch.open) {
      point.push_back(scratch.sorted[static_cast<std::size_t>(next[static_cast<std::size_t>(c)])]);
    }
    cast(setting, light, point, scratch, statistics);
    std::size_t kept = 0;
    for (std::size_t k = 0; k < scratch.open.size(); ++k) {
      const auto c = static_cast<std::size_t>(scratch.open[k]);
      if (scratch.blocked[k] == 0) {
        scratch.filled[c] = 1;
      } else if (++next[c] < scratch.start[c + 1]) {
        scratch.open[kept++] = scratch.open[k];
      }
    }
    scratch.open.resize(kept);
  }
}

/// Cells of one candidate, sorted.
std::vector<std::int32_t> bins_of(const Setting& setting, const LightPosition& light,
                                  Scratch& scratch, BinningStatistics& statistics) {
  scratch.filled.assign(static_cast<std::size_t>(setting.lookup.grid().cells()), 0);
  find_lit(setting, light, scratch, statistics);
  const std::int64_t rays_before = statistics.rays_cast;
  if (setting.rays == ShadowRays::none || setting.occluder.convex()) {
    for (const LitPoint& lit : scratch.lit) scratch.filled[static_cast<std::size_t>(lit.cell)] = 1;
  } else if (setting.rays == ShadowRays::all) {
    fill_by_all_rays(setting, light, scratch, statistics);
  } else {
    fill_by_needed_rays(setting, light, scratch, statistics);
  }
  std::vector<std::int32_t> cells;
  for (std::size_t c = 0; c < scratch.filled.size(); ++c) {
    if (scratch.filled[c] != 0) cells.push_back(static_cast<std::int32_t>(c));
  }
  const auto lit = static_cast<std::int64_t>(scratch.lit.size());
  statistics.repeated += lit - static_cast<std::int64_t>(cells.size());
  statistics.rays_left_out += lit - (statistics.rays_cast - rays_before);
  return cells;
}

void add(BinningStatistics& sum, const BinningStatistics& part) {
  sum.points_tested += part.points_tested;
  sum.back_facing += part.back_facing;
  sum.no_half_vector += part.no_half_vector;
  sum.repeated += part.repeated;
  sum.rays_cast += part.rays_cast;
  sum.rays_left_out += part.rays_left_out;
}

}  // namespace

BinningResult bin_candidates(const SurfacePoints& points, std::span<const LightPosition> candidates,
                             const BivariateGrid& grid, std::span<const std::uint8_t> valid,
                             const GrazingLimits& limits, const Occluder& occluder, ShadowRays rays,
                             int threads) {
  CHECK(valid.empty() || static_cast<int>(valid.size()) == grid.cells());
  const double tangent = limits.max_theta_d < std::numbers::pi / 2
                             ? std::tan(limits.max_theta_d)
                             : std::numeric_limits<double>::infinity();
  Setting setting{points, valid, CellLookup(grid), limits, tangent * tangent, occluder, rays, {}};
  for (Eigen::Index i = 0; i < points.size(); ++i) {
    const double cos_o = points.normal.col(i).dot(points.view.col(i));
    if (cos_o > 0 && cos_o >= limits.min_cos_o) {
      setting.in_view.push_back(static_cast<std::int32_t>(i));
    }
  }
  std::vector<std::vector<std::int32_t>> cells(candidates.size());
  std::vector<Scratch> scratch(static_cast<std::size_t>(std::max(1, threads)));
  std::vector<BinningStatistics> statistics(scratch.size());
  parallel_ranges(static_cast<std::int64_t>(candidates.size()), 8, threads,
                  [&](std::int64_t first, std::int64_t last, int worker) {
                    const auto w = static_cast<std::size_t>(worker);
                    for (auto i = static_cast<std::size_t>(first);
                         i < static_cast<std::size_t>(last); ++i) {
                      cells[i] = bins_of(setting, candidates[i], scratch[w], statistics[w]);
                    }
                  });
  BinningResult result;
  result.bins.grid = grid;
  result.bins.offset.push_back(0);
  for (const std::vector<std::int32_t>& of_one : cells) {
    result.bins.cell.insert(result.bins.cell.end(), of_one.begin(), of_one.end());
    result.bins.offset.push_back(static_cast<std::int64_t>(result.bins.cell.size()));
  }
  for (const BinningStatistics& part : statistics) add(result.statistics, part);
  result.statistics.convex = occluder.convex();
  return result;
}

}  // namespace lightrig
