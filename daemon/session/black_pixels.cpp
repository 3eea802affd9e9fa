#include "daemon/session/black_pixels.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <utility>

namespace lightrig {
namespace {

/// Share of the lit pixels from which something is in the way: less may be the pose.
constexpr double in_the_way = 0.01;
/// Estimates may err by this many standard deviations before they are held against a pixel.
constexpr double sure_deviations = 3;

double blocked_share(const ExtractionStatistics& s) {
  const std::int64_t lit = lit_sites(s);
  return lit > 0 ? static_cast<double>(s.blocked) / static_cast<double>(lit) : 0;
}

/// The light's observations with these rows, in their order; footprints go with theirs, which stand
/// first and as before.
BrdfObservations with_rows(const BrdfObservations& from, std::vector<BrdfObservation> rows,
                           const std::vector<std::size_t>& kept) {
  BrdfObservations all = from;
  all.rows = std::move(rows);
  std::vector<std::size_t> order = kept;
  std::ranges::sort(
      order, {}, [&](std::size_t i) { return std::pair(all.rows[i].channel, all.rows[i].cell); });
  std::vector<std::int32_t> place(all.rows.size(), -1);
  std::vector<BrdfObservation> sorted;
  for (const std::size_t i : order) {
    place[i] = static_cast<std::int32_t>(sorted.size());
    sorted.push_back(all.rows[i]);
  }
  for (Footprint& footprint : all.footprints) {
    footprint.row = place[static_cast<std::size_t>(footprint.row)];
  }
  std::erase_if(all.footprints, [](const Footprint& footprint) { return footprint.row < 0; });
  all.rows = std::move(sorted);
  return all;
}

/// Black rows as what they would be, were the material that dark.
BrdfObservations with_black(const BrdfObservations& from) {
  std::vector<BrdfObservation> rows = from.rows;
  rows.insert(rows.end(), from.black.begin(), from.black.end());
  std::vector<std::size_t> all(rows.size());
  std::iota(all.begin(), all.end(), std::size_t{0});
  return with_rows(from, std::move(rows), all);
}

}  // namespace

std::int64_t lit_sites(const ExtractionStatistics& s) {
  return s.sites - s.unlit - s.shadowed - s.grazing - s.invalid_cell - s.boundary - s.off_image;
}

bool stands_in_the_way(const ExtractionStatistics& s) { return blocked_share(s) > in_the_way; }

Eigen::ArrayXXd least_shown(const std::vector<Material>& materials, const BrdfBasis& basis) {
  Eigen::ArrayXXd least = Eigen::ArrayXXd::Zero(basis.grid.cells(), 1);
  for (int cell = 0; cell < basis.grid.cells() && !materials.empty(); ++cell) {
    double f = std::numeric_limits<double>::infinity();
    for (const Material& material : materials)
      f = std::min(f, material.table.f.row(cell).minCoeff());
    if (basis.valid[static_cast<std::size_t>(cell)] != 0 && std::isfinite(f)) least(cell, 0) = f;
  }
  return least;
}

Eigen::ArrayXXd surely_shown(const Reconstruction& estimate, const LogMapping& mapping,
                             const Eigen::ArrayXXd& least_f) {
  const BrdfTable& brdf = estimate.brdf;
  Eigen::ArrayXXd least = Eigen::ArrayXXd::Zero(brdf.f.rows(), brdf.f.cols());
  for (Eigen::Index channel = 0; channel < least.cols(); ++channel) {
    for (int cell = 0; cell < brdf.grid.cells(); ++cell) {
      const double f = brdf.f(cell, channel);
      if (std::isfinite(f)) {
        const double deviation = estimate.log_stddev(cell, channel) / ln_slope(mapping, cell, f);
        const double low =
            unmap_value(mapping, cell, map_value(mapping, cell, f) - sure_deviations * deviation);
        if (low > mapping.floor) least(cell, channel) = low;
      }
      least(cell, channel) = std::max(least(cell, channel), least_f(cell, 0));
    }
  }
  return least;
}

bool tells_more_blocked(const BrdfObservations& light, const Eigen::ArrayXXd& least_f) {
  return std::ranges::any_of(light.doubtful, [&](const BlackSites& black) {
    const auto channel = std::min<Eigen::Index>(black.channel, least_f.cols() - 1);
    return least_f(black.cell, channel) >= black.telling_f;
  });
}

BrdfObservations without_dark(const BrdfObservations& light) {
  std::vector<std::size_t> kept;
  for (std::size_t i = 0; i < light.rows.size(); ++i) {
    if (light.rows[i].kind != BrdfObservation::Kind::below) kept.push_back(i);
  }
  return with_rows(light, light.rows, kept);
}

std::vector<BrdfObservations> believed(const std::vector<BrdfObservations>& measured) {
  const auto mostly_black = std::ranges::count_if(
      measured, [](const BrdfObservations& o) { return blocked_share(o.statistics) > 0.5; });
  const bool dark_material = 2 * static_cast<std::size_t>(mostly_black) > measured.size();
  std::vector<BrdfObservations> out;
  for (const BrdfObservations& one : measured) {
    const bool blocked = stands_in_the_way(one.statistics);
    out.push_back(dark_material ? with_black(one) : blocked ? without_dark(one) : one);
  }
  return out;
}

}  // namespace lightrig
