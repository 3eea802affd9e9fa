// A distant light seen from afar shows one column of the table, one half vector, and rows that
// depend on the normal alone.

#include <algorithm>
#include <bit>
#include <cmath>

#include "core/binning_setting.h"
#include "core/half_diff.h"
#include "core/lanes.h"

namespace lightrig {

namespace {

/// Points of one row that a first walk brings along for shadow rays: most rows need no more.
constexpr std::int32_t first_tries = 4;

void want(BinningScratch& scratch, int row, std::int32_t points, std::int32_t skipped) {
  const auto r = static_cast<std::size_t>(row);
  scratch.wanted[r] = points;
  scratch.skipped[r] = skipped;
  if (points > 0) scratch.wanted_rows[r / 64] |= std::uint64_t{1} << (r % 64);
}

/// The first and last wanted row of from … to; none: first > last.
struct RowRange {
  int first, last;
};
[[gnu::always_inline]] inline RowRange wanted_between(const std::vector<std::uint64_t>& rows,
                                                      int from, int to) {
  RowRange range{to + 1, from - 1};
  for (int word = from / 64; word <= to / 64; ++word) {
    std::uint64_t bits = rows[static_cast<std::size_t>(word)];
    if (word == from / 64) bits &= ~std::uint64_t{0} << (from % 64);
    if (word == to / 64) bits &= ~std::uint64_t{0} >> (63 - to % 64);
    if (bits == 0) continue;
    range.first = std::min(range.first, 64 * word + std::countr_zero(bits));
    range.last = 64 * word + 63 - std::countl_zero(bits);
  }
  return range;
}

/// Walks the bundles whose normals may fill a row that is still wanted, eight points at a time, and
/// lists their lit points in wanted rows: as many as each row wants after those that it passes
/// over. What can show nothing new is left out. Returns the points walked.
[[gnu::always_inline]] inline std::int64_t walk_body(const BinningSetting& setting,
                                                     const LightPosition& light,
                                                     const Eigen::Vector3d& h,
                                                     BinningScratch& scratch,
                                                     BinningStatistics& statistics) {
  const CellLookup& lookup = setting.lookup;
  const PointColumns& points = setting.in_view;
  const double lx = light.p.x(), ly = light.p.y(), lz = light.p.z();
  const double hx = h.x(), hy = h.y(), hz = h.z();
  const double min_cos_i = setting.limits.min_cos_i;
  std::int64_t walked = 0, lit_points = 0;
  for (std::size_t b = 0; b < setting.bundles.size(); ++b) {
    if (!(scratch.cosine[b] > 0) || scratch.cosine[b] < min_cos_i) continue;
    const int from = lookup.row(scratch.least[b]), to = lookup.row(scratch.greatest[b]);
    RowRange rows = wanted_between(scratch.wanted_rows, from, to);
    const auto last = static_cast<std::size_t>(setting.bundles.first[b + 1]);
    for (auto i = static_cast<std::size_t>(setting.bundles.first[b]);
         i < last && rows.first <= rows.last; i += lane_width) {
      const Lanes nx = lanes_at(points.nx.data() + i), ny = lanes_at(points.ny.data() + i),
                  nz = lanes_at(points.nz.data() + i);
      const Lanes cos_i = nx * lx + ny * ly + nz * lz;
      const Lanes x = nx - hx, y = ny - hy, z = nz - hz;
      const Lanes chord2 = x * x + y * y + z * z;  // half_chord2(), eight times
      const auto lit = (cos_i > 0) & (cos_i >= min_cos_i);
      const auto within = lit & (chord2 >= lookup.row_begin(rows.first)) &
                          (chord2 < lookup.row_begin(rows.last + 1));
      // What lies beyond `last` belongs to the next bundle.
      const std::size_t count = std::min<std::size_t>(lane_width, last - i);
      const unsigned mine = (1U << count) - 1;
      walked += static_cast<std::int64_t>(count);
      lit_points += std::popcount(bits_of(lit) & mine);
      for (unsigned left = bits_of(within) & mine; left != 0; left &= left - 1) {
        const int lane = std::countr_zero(left);
        const int row = lookup.row(chord2[lane]);
        const auto r = static_cast<std::size_t>(row);
        if (scratch.wanted[r] == 0) continue;
        if (scratch.skipped[r] > 0) {
          --scratch.skipped[r];
          continue;
        }
        scratch.lit.push_back({points.index[i + static_cast<std::size_t>(lane)], row});
        if (--scratch.wanted[r] > 0) continue;
        scratch.wanted_rows[r / 64] &= ~(std::uint64_t{1} << (r % 64));
        rows = wanted_between(scratch.wanted_rows, from, to);
      }
    }
  }
  statistics.points_tested += lit_points;
  statistics.back_facing += walked - lit_points;
  return walked;
}

std::int64_t walk_bundles(const BinningSetting& setting, const LightPosition& light,
                          const Eigen::Vector3d& h, BinningScratch& scratch,
                          BinningStatistics& statistics) {
  scratch.lit.clear();
  return on_level(
      setting.level, [&]() __attribute__((always_inline)) {
        return walk_body(setting, light, h, scratch, statistics);
      });
}

void prepare(const BinningSetting& setting, BinningScratch& scratch) {
  const auto rows = static_cast<std::size_t>(setting.lookup.grid().n_h);
  if (scratch.wanted.size() == rows) return;
  scratch.wanted.assign(rows, 0);
  scratch.skipped.assign(rows, 0);
  scratch.wanted_rows.assign((rows + 63) / 64, 0);
  scratch.cosine.resize(setting.bundles.size());
  scratch.least.resize(setting.bundles.size());
  scratch.greatest.resize(setting.bundles.size());
}

}  // namespace

int fill_one_column(const BinningSetting& setting, const LightPosition& light,
                    BinningScratch& scratch, BinningStatistics& statistics) {
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
  prepare(setting, scratch);
  const Eigen::Vector3d h = sum / std::sqrt(s2);
  const BivariateGrid& grid = setting.lookup.grid();
  const int column = setting.lookup.column(tangent2);
  const bool rays = setting.casts_rays();
  std::fill(scratch.wanted_rows.begin(), scratch.wanted_rows.end(), 0);
  for (int row = 0; row < grid.n_h; ++row) {
    const bool valid = setting.has_statistics(grid.cell(row, column));
    want(scratch, row, !valid ? 0 : rays ? first_tries : 1, 0);
  }
  bundle_ranges(setting.bundles, light.p, h, scratch.cosine, scratch.least, scratch.greatest,
                setting.level);
  std::int64_t walked = walk_bundles(setting, light, h, scratch, statistics);
  if (!rays) {
    for (const LitPoint& lit : scratch.lit) scratch.filled[static_cast<std::size_t>(lit.key)] = 1;
  } else {
    const auto rows = static_cast<std::size_t>(grid.n_h);
    fill_by_needed_rays(setting, light, rows, scratch, statistics);
    // Where all points tried are blocked, the row's others are looked up.
    std::fill(scratch.wanted_rows.begin(), scratch.wanted_rows.end(), 0);
    bool more = false;
    for (int row = 0; row < grid.n_h; ++row) {
      const auto r = static_cast<std::size_t>(row);
      const bool open = scratch.filled[r] == 0 && scratch.wanted[r] == 0 &&
                        setting.has_statistics(grid.cell(row, column));
      want(scratch, row, open ? static_cast<std::int32_t>(in_view) : 0, first_tries);
      more = more || open;
    }
    if (more) {
      walked += walk_bundles(setting, light, h, scratch, statistics);
      fill_by_needed_rays(setting, light, rows, scratch, statistics);
    }
  }
  statistics.passed_over += std::max<std::int64_t>(0, in_view - walked);
  return column;
}

}  // namespace lightrig
