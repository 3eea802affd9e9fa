#include "core/candidate_bins.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>

#include "core/binning_kernels.h"
#include "core/cell_lookup.h"
#include "core/check.h"
#include "core/half_diff.h"
#include "core/parallel.h"
#include "core/planner_kernels.h"

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
  PointColumns in_view;        ///< points within the camera's grazing limit
  NormalBundles bundles;       ///< of in_view, where the view is the same everywhere; else empty
  bool one_view = false;       ///< every point is seen from one direction
  Eigen::Vector3d view;        ///< that direction
  int level = vector_level();  ///< of the processor

  bool casts_rays() const { return rays != ShadowRays::none && !occluder.convex(); }
  bool has_statistics(std::int32_t cell) const {
    return valid.empty() || valid[static_cast<std::size_t>(cell)] != 0;
  }
};

/// Memory that one worker uses again for every candidate.
struct Scratch {
  std::vector<LitPoint> lit;
  std::vector<std::uint8_t> filled;  ///< (cells)
  std::vector<std::uint8_t>
      wanted;  ///< (cells): 0 no, 1 may still be filled, 2 but not by its first
  std::vector<std::int32_t> start;   ///< (cells + 1)
  std::vector<std::int32_t> sorted;  ///< lit points by cell
  std::vector<std::int32_t> open;    ///< cells that still look for an unblocked point
  std::vector<std::int32_t> next, point;
  std::vector<Eigen::Vector3d> position, normal;
  std::vector<std::uint8_t> blocked;
  std::vector<double> cosine, least, greatest;  ///< (bundles)
  std::array<double, 1024> chord2, tangent2;
};

/// Shadow rays for scratch.point; scratch.blocked tells the outcome.
void cast(const Setting& setting, const LightPosition& light, Scratch& scratch,
          BinningStatistics& statistics) {
  scratch.position.clear();
  scratch.normal.clear();
  for (const std::int32_t i : scratch.point) {
    scratch.position.push_back(setting.points.position.col(i));
    scratch.normal.push_back(setting.points.normal.col(i));
  }
  scratch.blocked.assign(scratch.point.size(), 0);
  setting.occluder.blocked(scratch.position, scratch.normal, light, scratch.blocked);
  statistics.rays_cast += static_cast<std::int64_t>(scratch.point.size());
}

/// The lit points of one candidate, by the angles of every point.
void find_lit(const Setting& setting, const LightPosition& light, Scratch& scratch,
              BinningStatistics& statistics) {
  const PointColumns& points = setting.in_view;
  scratch.lit.clear();
  for (std::size_t first = 0; first < points.size(); first += scratch.chord2.size()) {
    const std::size_t count = std::min(scratch.chord2.size(), points.size() - first);
    angles_of_points(points, first, light, setting.limits.min_cos_i, setting.max_tangent2,
                     {scratch.chord2.data(), count}, {scratch.tangent2.data(), count},
                     setting.level);
    for (std::size_t i = 0; i < count; ++i) {
      if (scratch.chord2[i] < 0) {
        ++(scratch.chord2[i] == no_half_vector ? statistics.no_half_vector
                                               : statistics.back_facing);
        continue;
      }
      ++statistics.points_tested;
      const std::int32_t cell = setting.lookup.grid().cell(
          setting.lookup.row(scratch.chord2[i]), setting.lookup.column(scratch.tangent2[i]));
      if (setting.has_statistics(cell)) scratch.lit.push_back({points.index[first + i], cell});
    }
  }
}

/// One ray per lit point: the plain reference.
void fill_by_all_rays(const Setting& setting, const LightPosition& light, Scratch& scratch,
                      BinningStatistics& statistics) {
  scratch.point.clear();
  for (const LitPoint& lit : scratch.lit) scratch.point.push_back(lit.point);
  cast(setting, light, scratch, statistics);
  for (std::size_t k = 0; k < scratch.lit.size(); ++k) {
    if (scratch.blocked[k] == 0) {
      scratch.filled[static_cast<std::size_t>(scratch.lit[k].cell)] = 1;
    }
  }
}

/// Rounds of one ray per cell that has not shown an unblocked point yet, over scratch.lit.
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
  scratch.next.assign(scratch.start.begin(), scratch.start.end() - 1);
  for (const LitPoint& lit : scratch.lit) {
    const auto at = static_cast<std::size_t>(scratch.next[static_cast<std::size_t>(lit.cell)]++);
    scratch.sorted[at] = lit.point;
  }
  std::copy(scratch.start.begin(), scratch.start.end() - 1, scratch.next.begin());
  while (!scratch.open.empty()) {
    scratch.point.clear();
    for (const std::int32_t c : scratch.open) {
      const std::int32_t at = scratch.next[static_cast<std::size_t>(c)];
      scratch.point.push_back(scratch.sorted[static_cast<std::size_t>(at)]);
    }
    cast(setting, light, scratch, statistics);
    std::size_t kept = 0;
    for (std::size_t k = 0; k < scratch.open.size(); ++k) {
      const auto c = static_cast<std::size_t>(scratch.open[k]);
      if (scratch.blocked[k] == 0) {
        scratch.filled[c] = 1;
      } else if (++scratch.next[c] < scratch.start[c + 1]) {
        scratch.open[kept++] = scratch.open[k];
      }
    }
    scratch.open.resize(kept);
  }
}

/// Near lamps, perspective views and the plain reference: every point is looked at.
void fill_from_all_points(const Setting& setting, const LightPosition& light, Scratch& scratch,
                          BinningStatistics& statistics) {
  find_lit(setting, light, scratch, statistics);
  if (!setting.casts_rays()) {
    for (const LitPoint& lit : scratch.lit) scratch.filled[static_cast<std::size_t>(lit.cell)] = 1;
  } else if (setting.rays == ShadowRays::all) {
    fill_by_all_rays(setting, light, scratch, statistics);
  } else {
    fill_by_needed_rays(setting, light, scratch, statistics);
  }
}

/// Walks the bundles whose normals may fill a row of one column that is still wanted, and lists
/// their lit points in wanted cells, without the first where 2 is written there: that one has been
/// tried. With `first_only` the first of each cell, which is then no longer wanted. Returns the
/// points walked.
std::int64_t walk_bundles(const Setting& setting, const LightPosition& light,
                          const Eigen::Vector3d& h, int column, bool first_only, Scratch& scratch,
                          BinningStatistics& statistics) {
  const CellLookup& lookup = setting.lookup;
  const PointColumns& points = setting.in_view;
  const double lx = light.p.x(), ly = light.p.y(), lz = light.p.z();
  std::int64_t walked = 0;
  scratch.lit.clear();
  for (std::size_t b = 0; b < setting.bundles.size(); ++b) {
    if (!(scratch.cosine[b] > 0) || scratch.cosine[b] < setting.limits.min_cos_i) continue;
    const int from = lookup.row(scratch.least[b]), to = lookup.row(scratch.greatest[b]);
    bool useful = false;
    for (int row = from; row <= to && !useful; ++row) {
      useful = scratch.wanted[static_cast<std::size_t>(lookup.grid().cell(row, column))] != 0;
    }
    if (!useful) continue;
    const auto first = static_cast<std::size_t>(setting.bundles.first[b]);
    const auto last = static_cast<std::size_t>(setting.bundles.first[b + 1]);
    walked += static_cast<std::int64_t>(last - first);
    for (std::size_t i = first; i < last; ++i) {
      const double cos_i = points.nx[i] * lx + points.ny[i] * ly + points.nz[i] * lz;
      if (!(cos_i > 0) || cos_i < setting.limits.min_cos_i) {
        ++statistics.back_facing;
        continue;
      }
      ++statistics.points_tested;
      const double chord2 =
          half_chord2(points.nx[i], points.ny[i], points.nz[i], h.x(), h.y(), h.z());
      const std::int32_t cell = lookup.grid().cell(lookup.row(chord2), column);
      std::uint8_t& wanted = scratch.wanted[static_cast<std::size_t>(cell)];
      if (wanted == 0) continue;
      if (wanted == 2) {
        wanted = 1;
        continue;
      }
      scratch.lit.push_back({points.index[i], cell});
      if (first_only) wanted = 0;
    }
  }
  return walked;
}

/// A distant light seen from afar shows one column of the table, one half vector, and rows that
/// depend on the normal alone: whole bundles of normals are passed over where they can show
/// nothing new. Returns the column.
int fill_one_column(const Setting& setting, const LightPosition& light, Scratch& scratch,
                    BinningStatistics& statistics) {
  const auto in_view = static_cast<std::int64_t>(setting.in_view.size());
  const Eigen::Vector3d sum = light.p + setting.view;
  const double s2 = sum.x() * sum.x() + sum.y() * sum.y() + sum.z() * sum.z();
  const double tangent2 = difference_tangent2(light.p, setting.view);
  if (!(s2 > 0)) {
    statistics.no_half_vector += in_view;
    return 0;
  }
  if (!(tangent2 <= setting.max_tangent2)) {
    statistics.back_facing += in_view;
    return 0;
  }
  const Eigen::Vector3d h = sum / std::sqrt(s2);
  const BivariateGrid& grid = setting.lookup.grid();
  const int column = setting.lookup.column(tangent2);
  for (int row = 0; row < grid.n_h; ++row) {
    const auto cell = static_cast<std::size_t>(grid.cell(row, column));
    scratch.wanted[cell] = setting.has_statistics(grid.cell(row, column)) ? 1 : 0;
  }
  scratch.cosine.resize(setting.bundles.size());
  scratch.least.resize(setting.bundles.size());
  scratch.greatest.resize(setting.bundles.size());
  bundle_ranges(setting.bundles, light.p, h, scratch.cosine, scratch.least, scratch.greatest,
                setting.level);
  std::int64_t walked = walk_bundles(setting, light, h, column, true, scratch, statistics);
  if (!setting.casts_rays()) {
    for (const LitPoint& lit : scratch.lit) scratch.filled[static_cast<std::size_t>(lit.cell)] = 1;
  } else {
    // One ray for each cell; where it is blocked, the cell's other points are looked up.
    fill_by_all_rays(setting, light, scratch, statistics);
    bool blocked = false;
    for (int row = 0; row < grid.n_h; ++row) {
      scratch.wanted[static_cast<std::size_t>(grid.cell(row, column))] = 0;
    }
    for (const LitPoint& lit : scratch.lit) {
      const auto cell = static_cast<std::size_t>(lit.cell);
      scratch.wanted[cell] = scratch.filled[cell] == 0 ? 2 : 0;
      blocked = blocked || scratch.filled[cell] == 0;
    }
    if (blocked) {
      walked += walk_bundles(setting, light, h, column, false, scratch, statistics);
      fill_by_needed_rays(setting, light, scratch, statistics);
    }
  }
  statistics.passed_over += std::max<std::int64_t>(0, in_view - walked);
  return column;
}

/// Cells of one candidate, sorted.
std::vector<std::int32_t> bins_of(const Setting& setting, const LightPosition& light,
                                  Scratch& scratch, BinningStatistics& statistics) {
  const BivariateGrid& grid = setting.lookup.grid();
  const auto cells = static_cast<std::size_t>(grid.cells());
  scratch.filled.resize(cells, 0);  // all zero again after every candidate
  scratch.wanted.resize(cells, 0);
  const std::int64_t rays_before = statistics.rays_cast;
  const std::int64_t lit_before = statistics.points_tested;
  statistics.back_facing +=
      setting.points.size() - static_cast<Eigen::Index>(setting.in_view.size());
  std::size_t at = 0, step = 1;  // where cells can have been filled
  if (light.distant && setting.one_view && setting.rays != ShadowRays::all) {
    at = static_cast<std::size_t>(fill_one_column(setting, light, scratch, statistics));
    step = static_cast<std::size_t>(grid.n_d);
  } else {
    fill_from_all_points(setting, light, scratch, statistics);
  }
  std::vector<std::int32_t> filled;
  for (; at < cells; at += step) {
    if (scratch.filled[at] == 0) continue;
    filled.push_back(static_cast<std::int32_t>(at));
    scratch.filled[at] = 0;
  }
  const std::int64_t lit = statistics.points_tested - lit_before;
  statistics.repeated += std::max<std::int64_t>(0, lit - static_cast<std::int64_t>(filled.size()));
  statistics.rays_left_out += std::max<std::int64_t>(0, lit - (statistics.rays_cast - rays_before));
  return filled;
}

void add(BinningStatistics& sum, const BinningStatistics& part) {
  sum.points_tested += part.points_tested;
  sum.back_facing += part.back_facing;
  sum.no_half_vector += part.no_half_vector;
  sum.repeated += part.repeated;
  sum.passed_over += part.passed_over;
  sum.rays_cast += part.rays_cast;
  sum.rays_left_out += part.rays_left_out;
}

/// The points within the camera's limit, and whether they are all seen from one direction.
void gather_in_view(Setting& setting) {
  const SurfacePoints& points = setting.points;
  PointColumns& out = setting.in_view;
  for (Eigen::Index i = 0; i < points.size(); ++i) {
    const Eigen::Vector3d n = points.normal.col(i), v = points.view.col(i),
                          p = points.position.col(i);
    const double cos_o = n.dot(v);
    if (!(cos_o > 0) || cos_o < setting.limits.min_cos_o) continue;
    out.index.push_back(static_cast<std::int32_t>(i));
    out.px.push_back(p.x());
    out.py.push_back(p.y());
    out.pz.push_back(p.z());
    out.nx.push_back(n.x());
    out.ny.push_back(n.y());
    out.nz.push_back(n.z());
    out.vx.push_back(v.x());
    out.vy.push_back(v.y());
    out.vz.push_back(v.z());
  }
  if (out.size() == 0) return;
  setting.view = {out.vx[0], out.vy[0], out.vz[0]};
  setting.one_view = true;
  for (std::size_t i = 0; i < out.size() && setting.one_view; ++i) {
    setting.one_view = out.vx[i] == out.vx[0] && out.vy[i] == out.vy[0] && out.vz[i] == out.vz[0];
  }
  if (setting.one_view) setting.bundles = bundle_normals(out, 16);
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
  Setting setting{.points = points,
                  .valid = valid,
                  .lookup = CellLookup(grid),
                  .limits = limits,
                  .max_tangent2 = tangent * tangent,
                  .occluder = occluder,
                  .rays = rays,
                  .in_view = {},
                  .bundles = {},
                  .view = Eigen::Vector3d::UnitZ()};
  gather_in_view(setting);
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
