#include "core/candidate_bins.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>

#include "core/binning_setting.h"
#include "core/check.h"
#include "core/parallel.h"

namespace lightrig {

namespace {

/// Shadow rays for scratch.point; scratch.blocked tells the outcome.
void cast_shadow_rays(const BinningSetting& setting, const LightPosition& light,
                      BinningScratch& scratch, BinningStatistics& statistics) {
  scratch.position.clear();
  scratch.normal.clear();
  for (const std::int32_t i : scratch.point) {
    scratch.position.push_back(setting.points.position.col(i));
    scratch.normal.push_back(setting.points.normal.col(i));
  }
  scratch.blocked.assign(scratch.point.size(), 0);
  setting.occluder.blocked(scratch.position, scratch.normal, light, scratch.blocked);
  statistics.rays_cast += static_cast<std::int64_t>(scratch.point.size());
  statistics.in_shadow += std::count(scratch.blocked.begin(), scratch.blocked.end(), 1);
}

/// Rounds of one ray per cell that has not shown an unblocked point yet, over scratch.lit.
void fill_by_needed_rays(const BinningSetting& setting, const LightPosition& light,
                         BinningScratch& scratch, BinningStatistics& statistics) {
  const std::size_t cells = scratch.filled.size();
  scratch.start.assign(cells + 1, 0);
  for (const BinnedPoint& lit : scratch.lit) {
    ++scratch.start[static_cast<std::size_t>(lit.cell) + 1];
  }
  scratch.open.clear();
  for (std::size_t c = 0; c < cells; ++c) {
    if (scratch.start[c + 1] > 0 && scratch.filled[c] == 0) {
      scratch.open.push_back(static_cast<std::int32_t>(c));
    }
    scratch.start[c + 1] += scratch.start[c];
  }
  scratch.sorted.resize(scratch.lit.size());
  scratch.next.assign(scratch.start.begin(), scratch.start.end() - 1);
  for (const BinnedPoint& lit : scratch.lit) {
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
    cast_shadow_rays(setting, light, scratch, statistics);
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

/// Points of one cell that a first look brings along for shadow rays: most cells need no more.
constexpr std::int32_t first_tries = 4;

/// The cells of all points under one light, −1 where they show none, and up to `most` points of
/// each cell in scratch.lit, as long as no point shows that cell for sure.
void find_lit(const BinningSetting& setting, const LightPosition& light, std::int32_t most,
              BinningScratch& scratch, BinningStatistics& statistics) {
  const PointColumns& points = setting.in_view;
  const CellLookup& lookup = setting.lookup;
  scratch.lit.clear();
  scratch.cell_of_point.resize(points.size());
  scratch.tried.assign(static_cast<std::size_t>(lookup.grid().cells()), 0);
  const bool whole_sphere = light.distant || light.lobe.uniform();
  for (std::size_t first = 0; first < points.size(); first += scratch.chord2.size()) {
    const std::size_t count = std::min(scratch.chord2.size(), points.size() - first);
    angles_of_points(points, first, light, setting.limits.min_cos_i, setting.max_tangent2,
                     {scratch.chord2.data(), count}, {scratch.tangent2.data(), count},
                     setting.level);
    for (std::size_t i = 0; i < count; ++i) {
      std::int32_t& cell = scratch.cell_of_point[first + i];
      cell = -1;
      if (scratch.chord2[i] < 0) {
        ++(scratch.chord2[i] == no_half_vector ? statistics.no_half_vector
                                               : statistics.back_facing);
        continue;
      }
      if (!whole_sphere && !light.reaches(setting.points.position.col(points.index[first + i]))) {
        ++statistics.back_facing;
        continue;
      }
      ++statistics.points_tested;
      const std::int32_t found =
          lookup.grid().cell(lookup.row(scratch.chord2[i]), lookup.column(scratch.tangent2[i]));
      if (!setting.has_statistics(found)) continue;
      cell = found;
      std::int32_t& tried = scratch.tried[static_cast<std::size_t>(found)];
      if (tried >= most || scratch.filled[static_cast<std::size_t>(found)] != 0) continue;
      if (setting.is_sure(light, points.index[first + i])) {
        scratch.filled[static_cast<std::size_t>(found)] = 1;
        continue;
      }
      ++tried;
      scratch.lit.push_back({points.index[first + i], found});
    }
  }
}

/// The points of cells that are still empty after first_tries of them, but for those, in
/// scratch.lit.
void find_others(const BinningSetting& setting, BinningScratch& scratch) {
  scratch.lit.clear();
  for (std::size_t i = 0; i < scratch.cell_of_point.size(); ++i) {
    if (scratch.cell_of_point[i] < 0) continue;
    const auto cell = static_cast<std::size_t>(scratch.cell_of_point[i]);
    if (scratch.filled[cell] != 0) continue;
    if (scratch.tried[cell]-- > 0) continue;
    scratch.lit.push_back({setting.in_view.index[i], scratch.cell_of_point[i]});
  }
}

/// One ray per lit point: the plain reference.
void fill_by_all_rays(const BinningSetting& setting, const LightPosition& light,
                      BinningScratch& scratch, BinningStatistics& statistics) {
  scratch.point.clear();
  for (const BinnedPoint& lit : scratch.lit) scratch.point.push_back(lit.point);
  cast_shadow_rays(setting, light, scratch, statistics);
  for (std::size_t k = 0; k < scratch.lit.size(); ++k) {
    if (scratch.blocked[k] == 0) {
      scratch.filled[static_cast<std::size_t>(scratch.lit[k].cell)] = 1;
    }
  }
}

/// Near lamps, perspective views and the plain reference: every point is looked at.
void fill_from_all_points(const BinningSetting& setting, const LightPosition& light,
                          BinningScratch& scratch, BinningStatistics& statistics) {
  const bool all = setting.rays == ShadowRays::all;
  const bool rays = setting.casts_rays();
  find_lit(setting, light,
           !rays ? 1
           : all ? std::numeric_limits<std::int32_t>::max()
                 : first_tries,
           scratch, statistics);
  if (!rays) {
    for (const BinnedPoint& lit : scratch.lit)
      scratch.filled[static_cast<std::size_t>(lit.cell)] = 1;
  } else if (all) {
    fill_by_all_rays(setting, light, scratch, statistics);
  } else {
    fill_by_needed_rays(setting, light, scratch, statistics);
    find_others(setting, scratch);
    if (!scratch.lit.empty()) {
      fill_by_needed_rays(setting, light, scratch, statistics);
    }
  }
}

/// Appends the cells of one candidate, sorted.
void bin(const BinningSetting& setting, const LightPosition& light, BinningScratch& scratch,
         std::vector<std::int32_t>& out, BinningStatistics& statistics) {
  const BivariateGrid& grid = setting.lookup.grid();
  const bool one_column = light.distant && setting.one_view && setting.rays != ShadowRays::all;
  scratch.filled.resize(static_cast<std::size_t>(one_column ? grid.n_h : grid.cells()), 0);
  const std::int64_t rays_before = statistics.rays_cast;
  const std::int64_t lit_before = statistics.points_tested;
  const std::int64_t shadow_before = statistics.in_shadow;
  statistics.back_facing +=
      setting.points.size() - static_cast<Eigen::Index>(setting.in_view.size());
  const std::size_t before = out.size();
  int column = 0, step = 1;
  if (one_column) {
    column = fill_one_column(setting, light, scratch, statistics);
    step = grid.n_d;
  } else {
    fill_from_all_points(setting, light, scratch, statistics);
  }
  for (std::size_t key = 0; key < scratch.filled.size(); ++key) {
    if (scratch.filled[key] == 0) continue;
    out.push_back(static_cast<std::int32_t>(key) * step + column);
    scratch.filled[key] = 0;
  }
  const std::int64_t lit = statistics.points_tested - lit_before;
  const auto filled = static_cast<std::int64_t>(out.size() - before);
  statistics.repeated += lit - filled - (statistics.in_shadow - shadow_before);
  statistics.rays_left_out += lit - (statistics.rays_cast - rays_before);
}

void add_normal(PointColumns& to, const PointColumns& from, std::size_t i) {
  to.index.push_back(from.index[i]);
  to.nx.push_back(from.nx[i]);
  to.ny.push_back(from.ny[i]);
  to.nz.push_back(from.nz[i]);
}

/// Every `step`-th point of the bundles, in their order.
void sample_evenly(BinningSetting& setting, std::size_t step) {
  setting.sample_of_bundle.assign(1, 0);
  std::size_t next = step / 2;
  for (std::size_t b = 0; b < setting.bundles.size(); ++b) {
    for (; next < static_cast<std::size_t>(setting.bundles.first[b + 1]); next += step) {
      add_normal(setting.sample, setting.in_view, next);
    }
    setting.sample_of_bundle.push_back(static_cast<std::int32_t>(setting.sample.size()));
  }
  setting.sample.pad();
}

/// The points of each bundle that lie furthest out along their normals: those that the object
/// itself shades least.
void sample_outermost(BinningSetting& setting, std::size_t of_each) {
  const PointColumns& points = setting.in_view;
  setting.sample_of_bundle.assign(1, 0);
  std::vector<std::pair<double, std::size_t>> outwards;
  for (std::size_t b = 0; b < setting.bundles.size(); ++b) {
    outwards.clear();
    const auto last = static_cast<std::size_t>(setting.bundles.first[b + 1]);
    for (auto i = static_cast<std::size_t>(setting.bundles.first[b]); i < last; ++i) {
      outwards.emplace_back(-(points.nx[i] * points.px[i] + points.ny[i] * points.py[i] +
                              points.nz[i] * points.pz[i]),
                            i);
    }
    const std::size_t count = std::min(of_each, outwards.size());
    std::partial_sort(outwards.begin(), outwards.begin() + static_cast<std::ptrdiff_t>(count),
                      outwards.end());
    for (std::size_t k = 0; k < count; ++k) add_normal(setting.sample, points, outwards[k].second);
    setting.sample_of_bundle.push_back(static_cast<std::int32_t>(setting.sample.size()));
  }
  setting.sample.pad();
}

/// The horizon of each point of the sample.
void find_horizons(BinningSetting& setting, int threads) {
  setting.horizon.assign(setting.sample.size(), setting.sure_cosine);
  if (setting.occluder.convex()) return;
  parallel_ranges(static_cast<std::int64_t>(setting.sample.size()), 64, threads,
                  [&](std::int64_t first, std::int64_t last, int) {
                    for (auto i = static_cast<std::size_t>(first);
                         i < static_cast<std::size_t>(last); ++i) {
                      const Eigen::Index point = setting.sample.index[i];
                      setting.horizon[i] = setting.occluder.horizon(
                          setting.points.position.col(point), setting.points.normal.col(point));
                    }
                  });
}

/// The points within the camera's limit, and whether they are all seen from one direction.
void gather_in_view(BinningSetting& setting) {
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
  if (out.size() == 0) {
    out.pad();
    return;
  }
  setting.view = {out.vx[0], out.vy[0], out.vz[0]};
  setting.one_view = true;
  for (std::size_t i = 0; i < out.size() && setting.one_view; ++i) {
    setting.one_view = out.vx[i] == out.vx[0] && out.vy[i] == out.vy[0] && out.vz[i] == out.vz[0];
  }
  if (setting.one_view && setting.rays != ShadowRays::all) {
    setting.bundles = bundle_normals(out, 32);
    if (setting.casts_rays()) {
      sample_outermost(setting, 2);
    } else {
      sample_evenly(setting, std::max<std::size_t>(1, out.size() / 768));
    }
  }
  out.pad();
}

}  // namespace

void BinningStatistics::add(const BinningStatistics& part) {
  points_tested += part.points_tested;
  back_facing += part.back_facing;
  no_half_vector += part.no_half_vector;
  repeated += part.repeated;
  in_shadow += part.in_shadow;
  passed_over += part.passed_over;
  rays_cast += part.rays_cast;
  rays_left_out += part.rays_left_out;
}

BinningResult bin_candidates(const SurfacePoints& points, std::span<const LightPosition> candidates,
                             const BivariateGrid& grid, std::span<const std::uint8_t> valid,
                             const GrazingLimits& limits, const Occluder& occluder, ShadowRays rays,
                             int threads) {
  CHECK(valid.empty() || static_cast<int>(valid.size()) == grid.cells());
  const double tangent = limits.max_theta_d < std::numbers::pi / 2
                             ? std::tan(limits.max_theta_d)
                             : std::numeric_limits<double>::infinity();
  BinningSetting setting{.points = points,
                         .valid = valid,
                         .lookup = CellLookup(grid),
                         .limits = limits,
                         .max_tangent2 = tangent * tangent,
                         .occluder = occluder,
                         .rays = rays,
                         .in_view = {},
                         .bundles = {},
                         .sample = {},
                         .sample_of_bundle = {},
                         .horizon = {},
                         .view = Eigen::Vector3d::UnitZ(),
                         .sure_cosine = occluder.sure_cosine(!points.from_pixels)};
  gather_in_view(setting);
  // Only a distant light looks at horizons, and the plain reference at nothing of the kind.
  if (setting.sample.size() > 0 && setting.casts_rays() &&
      std::ranges::any_of(candidates, [](const LightPosition& l) { return l.distant; })) {
    find_horizons(setting, threads);
  }
  // Each worker appends to its own list; who did which candidate is written down.
  struct Part {
    std::size_t worker = 0, from = 0, count = 0;
  };
  std::vector<Part> part(candidates.size());
  const auto workers = static_cast<std::size_t>(std::max(1, threads));
  std::vector<BinningScratch> scratch(workers);
  std::vector<std::vector<std::int32_t>> cells(workers);
  std::vector<BinningStatistics> statistics(workers);
  parallel_ranges(static_cast<std::int64_t>(candidates.size()), 8, threads,
                  [&](std::int64_t first, std::int64_t last, int worker) {
                    const auto w = static_cast<std::size_t>(worker);
                    for (auto i = static_cast<std::size_t>(first);
                         i < static_cast<std::size_t>(last); ++i) {
                      const std::size_t from = cells[w].size();
                      bin(setting, candidates[i], scratch[w], cells[w], statistics[w]);
                      part[i] = {w, from, cells[w].size() - from};
                    }
                  });
  BinningResult result;
  result.bins.grid = grid;
  result.bins.offset.reserve(candidates.size() + 1);
  result.bins.offset.push_back(0);
  for (const Part& of_one : part) {
    result.bins.offset.push_back(result.bins.offset.back() +
                                 static_cast<std::int64_t>(of_one.count));
  }
  result.bins.cell.resize(static_cast<std::size_t>(result.bins.offset.back()));
  for (std::size_t i = 0; i < part.size(); ++i) {
    std::copy_n(cells[part[i].worker].data() + part[i].from, part[i].count,
                result.bins.cell.data() + result.bins.offset[i]);
  }
  for (const BinningStatistics& of_one : statistics) result.statistics.add(of_one);
  result.statistics.convex = occluder.convex() && !setting.casts_rays();
  return result;
}

}  // namespace lightrig
