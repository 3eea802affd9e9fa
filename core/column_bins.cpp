// A distant light seen from afar shows one column of the table, one half vector, and rows that
// depend on the normal alone.

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>

#include "core/binning_setting.h"
#include "core/half_diff.h"
#include "core/lanes.h"

namespace lightrig {

namespace {

/// One distant light over the points.
struct View {
  Eigen::Vector3d l, h;
  double min_cos_i;
};

std::uint64_t eight_bytes(const std::uint8_t* from) {
  std::uint64_t bytes = 0;
  std::memcpy(&bytes, from, sizeof bytes);
  return bytes;
}

/// Whether a row of from … to is looked for and not found yet.
[[gnu::always_inline]] inline bool any_open(const BinningScratch& scratch, int from, int to) {
  for (int row = from; row <= to; row += 8) {
    std::uint64_t open =
        eight_bytes(scratch.open_rows.data() + row) & ~eight_bytes(scratch.shown.data() + row);
    if (to - row < 7) open &= ~std::uint64_t{0} >> (8 * (7 - (to - row)));
    if (open != 0) return true;
  }
  return false;
}

/// The rows still open as intervals; those with a row or two between them are one.
void find_intervals(const BinningSetting& setting, BinningScratch& scratch) {
  scratch.intervals.clear();
  const int rows = setting.lookup.grid().n_h;
  int last = -8;
  for (int row = 0; row < rows; ++row) {
    const auto r = static_cast<std::size_t>(row);
    if (scratch.open_rows[r] == 0 || scratch.shown[r] != 0) continue;
    const double high = setting.lookup.row_begin(row + 1);
    if (row - last <= 3) {
      scratch.intervals.back().high = high;
    } else {
      scratch.intervals.push_back({setting.lookup.row_begin(row), high});
    }
    last = row;
  }
}

/// 4 sin²(θh/2) of points from first on, `dark` where they are not lit: half_chord2(), in a loop
/// that becomes vectors of the processor's own length.
constexpr double dark = 8;
[[gnu::always_inline]] inline void chords_of_lit(const PointColumns& points, std::size_t first,
                                                 std::size_t count, const View& view,
                                                 double* __restrict__ chord2) {
  const double* __restrict__ nx = points.nx.data() + first;
  const double* __restrict__ ny = points.ny.data() + first;
  const double* __restrict__ nz = points.nz.data() + first;
  const double lx = view.l.x(), ly = view.l.y(), lz = view.l.z();
  const double hx = view.h.x(), hy = view.h.y(), hz = view.h.z();
  const double min_cos_i = view.min_cos_i;
  for (std::size_t i = 0; i < count; ++i) {
    const double cos_i = nx[i] * lx + ny[i] * ly + nz[i] * lz;
    const double x = nx[i] - hx, y = ny[i] - hy, z = nz[i] - hz;
    const double all = x * x + y * y + z * z;
    const double lit = cos_i > 0 ? all : dark;
    chord2[i] = cos_i >= min_cos_i ? lit : dark;
  }
}

/// The same for the sample of points with horizons: `dark` where something may be in the way.
[[gnu::always_inline]] inline void chords_of_sure(const BinningSetting& setting, const View& view,
                                                  double* __restrict__ chord2) {
  chords_of_lit(setting.sample, 0, setting.sample.size(), view, chord2);
  const double* __restrict__ nx = setting.sample.nx.data();
  const double* __restrict__ ny = setting.sample.ny.data();
  const double* __restrict__ nz = setting.sample.nz.data();
  const double* __restrict__ horizon = setting.horizon.data();
  const double lx = view.l.x(), ly = view.l.y(), lz = view.l.z();
  for (std::size_t i = 0; i < setting.sample.size(); ++i) {
    const double cos_i = nx[i] * lx + ny[i] * ly + nz[i] * lz;
    chord2[i] = cos_i > horizon[i] ? chord2[i] : dark;
  }
}

/// Marks the rows of points; those that are dark mark the byte after the last row. Returns how many
/// are lit.
[[gnu::always_inline]] inline std::int64_t mark(std::span<const double> chord2,
                                                const CellLookup& lookup, std::uint8_t* shown) {
  std::int64_t unlit = 0;
  for (const double c : chord2) {
    const int skip = c == dark ? 1 : 0;
    shown[lookup.row(c) + skip] = 1;
    unlit += skip;
  }
  return static_cast<std::int64_t>(chord2.size()) - unlit;
}

/// The bundles that may be lit and show a row of the open intervals, in scratch.bundle.
[[gnu::always_inline]] inline void find_bundles(const BinningSetting& setting, const View& view,
                                                BinningScratch& scratch) {
  const std::size_t count = setting.bundles.size();
  const double* __restrict__ cosine = scratch.cosine.data();
  const double* __restrict__ least = scratch.least.data();
  const double* __restrict__ greatest = scratch.greatest.data();
  double* __restrict__ may = scratch.may.data();
  const double above = std::max(view.min_cos_i, std::numeric_limits<double>::min());
  for (std::size_t b = 0; b < count; ++b) may[b] = 0;
  for (const RowInterval& interval : scratch.intervals) {
    const double low = interval.low, high = interval.high;
    for (std::size_t b = 0; b < count; ++b) {
      const double below = least[b] < high ? 1.0 : 0.0;
      may[b] += greatest[b] >= low ? below : 0.0;
    }
  }
  std::int32_t* __restrict__ bundle = scratch.bundle.data();
  std::size_t found = 0;
  for (std::size_t b = 0; b < count; ++b) {
    bundle[found] = static_cast<std::int32_t>(b);
    found += may[b] > 0 && cosine[b] >= above ? 1 : 0;
  }
  scratch.bundles = found;
}

/// Calls visit(bundle, first, count, from, to) for the points of bundles that may show a row of
/// from … to that is open and not shown yet.
template <class Visit>
[[gnu::always_inline]] inline void visit_bundles(const BinningSetting& setting,
                                                 const BinningScratch& scratch,
                                                 const Visit& visit) {
  for (std::size_t i = 0; i < scratch.bundles; ++i) {
    const auto b = static_cast<std::size_t>(scratch.bundle[i]);
    const int from = setting.lookup.row(scratch.least[b]);
    const int to = setting.lookup.row(scratch.greatest[b]);
    if (!any_open(scratch, from, to)) continue;
    const auto first = static_cast<std::size_t>(setting.bundles.first[b]);
    visit(b, first, static_cast<std::size_t>(setting.bundles.first[b + 1]) - first, from, to);
  }
}

/// Points of the sample, and those of them whose chord is not `dark`: what was looked at before the
/// bundle that it is of.
struct Sampled {
  std::int64_t all = 0, lit = 0;
};
[[gnu::always_inline]] inline Sampled sampled(const BinningSetting& setting,
                                              const BinningScratch& scratch, std::size_t bundle) {
  Sampled of_bundle;
  const auto last = static_cast<std::size_t>(setting.sample_of_bundle[bundle + 1]);
  for (auto i = static_cast<std::size_t>(setting.sample_of_bundle[bundle]); i < last; ++i) {
    ++of_bundle.all;
    of_bundle.lit += scratch.sample_chords[i] < dark ? 1 : 0;
  }
  return of_bundle;
}

/// Marks the rows that lit points show: a sample of the points first, then the bundles that may
/// show what is missing. Returns the points looked at.
[[gnu::always_inline]] inline std::int64_t mark_body(const BinningSetting& setting,
                                                     const View& view, BinningScratch& scratch,
                                                     BinningStatistics& statistics) {
  std::int64_t walked = 0, lit = 0;
  const auto look_at = [&](const PointColumns& points, std::size_t first, std::size_t count,
                           double* chord2) __attribute__((always_inline)) {
    chords_of_lit(points, first, count, view, chord2);
    lit += mark({chord2, count}, setting.lookup, scratch.shown.data());
    walked += static_cast<std::int64_t>(count);
  };
  look_at(setting.sample, 0, setting.sample.size(), scratch.sample_chords.data());
  find_intervals(setting, scratch);
  find_bundles(setting, view, scratch);
  visit_bundles(
      setting, scratch,
      [&](std::size_t bundle, std::size_t first, std::size_t count, int, int)
          __attribute__((always_inline)) {
            look_at(setting.in_view, first, count, scratch.chords.data());
            const Sampled again = sampled(setting, scratch, bundle);
            walked -= again.all;
            lit -= again.lit;
          });
  statistics.points_tested += lit;
  statistics.back_facing += walked - lit;
  return walked;
}

/// Marks the rows that lit points show which a shadow ray finds open: one ray after another, each
/// for a row that is still missing. Returns the points looked at.
[[gnu::always_inline]] inline std::int64_t cast_body(const BinningSetting& setting,
                                                     const LightPosition& light, const View& view,
                                                     BinningScratch& scratch,
                                                     BinningStatistics& statistics) {
  std::int64_t walked = 0, lit = 0;
  double* chord2 = scratch.chords.data();
  const auto open = [&](int row) {
    const auto r = static_cast<std::size_t>(row);
    return scratch.open_rows[r] != 0 && scratch.shown[r] == 0;
  };
  const auto cast = [&](std::size_t bundle, std::size_t first, std::size_t count, int from, int to)
      __attribute__((always_inline)) {
    while (!open(from)) ++from;
    while (!open(to)) --to;
    const double low = setting.lookup.row_begin(from), high = setting.lookup.row_begin(to + 1);
    chords_of_lit(setting.in_view, first, count, view, chord2);
    // Points that were sure count already.
    const std::int64_t sure = sampled(setting, scratch, bundle).lit;
    walked += static_cast<std::int64_t>(count) - sure;
    lit -= sure;
    for (std::size_t i = 0; i < count; ++i) lit += chord2[i] < dark ? 1 : 0;
    // Most bundles show no open row after all, which a count without branches tells; in the others
    // nothing foretells which points do.
    const double below = std::min(high, dark);
    double shows = 0;
    for (std::size_t i = 0; i < count; ++i) {
      const double above = chord2[i] >= low ? 1.0 : 0.0;
      shows += chord2[i] < below ? above : 0.0;
    }
    if (shows == 0) return;
    std::int32_t* __restrict__ hit = scratch.hit.data();
    std::size_t hits = 0;
    for (std::size_t i = 0; i < count; ++i) {
      hit[hits] = static_cast<std::int32_t>(i);
      hits += static_cast<std::size_t>((chord2[i] >= low) & (chord2[i] < below));
    }
    for (std::size_t k = 0; k < hits; ++k) {
      const auto i = static_cast<std::size_t>(hit[k]);
      const int row = setting.lookup.row(chord2[i]);
      if (!open(row)) continue;
      std::uint8_t& shown = scratch.shown[static_cast<std::size_t>(row)];
      shown = setting.is_sure(light, setting.in_view.index[first + i]) ? 1 : 0;
      if (shown != 0) continue;
      ++statistics.rays_cast;
      shown = setting.occluder.blocked(setting.in_view.position(first + i),
                                       setting.in_view.normal(first + i), light)
                  ? 0
                  : 1;
      statistics.in_shadow += shown == 0 ? 1 : 0;
    }
  };
  find_bundles(setting, view, scratch);
  visit_bundles(setting, scratch, cast);
  statistics.points_tested += lit;
  statistics.back_facing += walked - lit;
  return walked;
}

/// Marks the rows that points above their horizons show. Returns the points looked at.
[[gnu::always_inline]] inline std::int64_t mark_sure_body(const BinningSetting& setting,
                                                          const View& view, BinningScratch& scratch,
                                                          BinningStatistics& statistics) {
  double* chord2 = scratch.sample_chords.data();
  const std::size_t count = setting.sample.size();
  chords_of_sure(setting, view, chord2);
  // Most points are unlit or below their horizon: those that are not are told apart first.
  std::int32_t* __restrict__ hit = scratch.hit.data();
  std::size_t hits = 0;
  for (std::size_t i = 0; i < count; ++i) {
    hit[hits] = static_cast<std::int32_t>(i);
    hits += static_cast<std::size_t>(chord2[i] < dark);
  }
  for (std::size_t k = 0; k < hits; ++k) {
    const double c = chord2[static_cast<std::size_t>(hit[k])];
    scratch.shown[static_cast<std::size_t>(setting.lookup.row(c))] = 1;
  }
  statistics.points_tested += static_cast<std::int64_t>(hits);
  return static_cast<std::int64_t>(hits);
}

std::int64_t mark_sure(const BinningSetting& setting, const View& view, BinningScratch& scratch,
                       BinningStatistics& statistics) {
  return on_level(
      setting.level, [&]() __attribute__((always_inline)) {
        return mark_sure_body(setting, view, scratch, statistics);
      });
}

std::int64_t mark_rows(const BinningSetting& setting, const View& view, BinningScratch& scratch,
                       BinningStatistics& statistics) {
  return on_level(
      setting.level, [&]() __attribute__((always_inline)) {
        return mark_body(setting, view, scratch, statistics);
      });
}

/// Marks what of the rows still missing shadow rays find open. Returns the points looked at.
std::int64_t cast_for_rows(const BinningSetting& setting, const LightPosition& light,
                           const View& view, BinningScratch& scratch,
                           BinningStatistics& statistics) {
  find_intervals(setting, scratch);
  if (scratch.intervals.empty()) return 0;
  return on_level(
      setting.level, [&]() __attribute__((always_inline)) {
        return cast_body(setting, light, view, scratch, statistics);
      });
}

/// Rows that were looked for and shown are filled.
void take_shown(std::size_t rows, BinningScratch& scratch) {
  for (std::size_t r = 0; r < rows; ++r) {
    scratch.filled[r] = scratch.shown[r] & scratch.open_rows[r];
  }
}

void prepare(const BinningSetting& setting, BinningScratch& scratch) {
  const auto rows = static_cast<std::size_t>(setting.lookup.grid().n_h);
  if (scratch.shown.size() == rows + 8) return;
  scratch.open_rows.assign(rows + 8, 0);
  scratch.shown.assign(rows + 8, 0);
  scratch.intervals.reserve(rows);
  const std::size_t bundles = setting.bundles.size();
  for (auto* of_bundle : {&scratch.cosine, &scratch.least, &scratch.greatest, &scratch.may}) {
    of_bundle->resize(bundles);
  }
  scratch.bundle.resize(bundles + 1);
  std::size_t most = setting.sample.size();
  for (std::size_t b = 0; b < bundles; ++b) {
    most = std::max(
        most, static_cast<std::size_t>(setting.bundles.first[b + 1] - setting.bundles.first[b]));
  }
  scratch.chords.resize(most);
  scratch.sample_chords.resize(setting.sample.size());
  scratch.hit.resize(most + 1);
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
  const View view{light.p, sum / std::sqrt(s2), setting.limits.min_cos_i};
  const BivariateGrid& grid = setting.lookup.grid();
  const int column = setting.lookup.column(tangent2);
  const auto rows = static_cast<std::size_t>(grid.n_h);
  for (std::size_t r = 0; r < rows; ++r) {
    scratch.open_rows[r] = setting.has_statistics(grid.cell(static_cast<int>(r), column)) ? 1 : 0;
    scratch.shown[r] = 0;
  }
  bundle_ranges(setting.bundles, view.l, view.h, scratch.cosine, scratch.least, scratch.greatest,
                setting.level);
  std::int64_t walked = 0;
  if (setting.casts_rays()) {
    walked = mark_sure(setting, view, scratch, statistics);
    walked += cast_for_rows(setting, light, view, scratch, statistics);
  } else {
    walked = mark_rows(setting, view, scratch, statistics);
  }
  take_shown(rows, scratch);
  statistics.passed_over += in_view - walked;
  return column;
}

}  // namespace lightrig
