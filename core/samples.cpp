#include "core/samples.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <optional>

#include "core/cell_lookup.h"
#include "core/check.h"
#include "core/pixel_neighbours.h"
#include "core/site_points.h"

namespace lightrig {
namespace {

/// Sums over the sites of one (cell, channel). a = E cos θi, the geometry of a site.
struct CellSum {
  std::int32_t measured = 0, dark = 0, saturated = 0;
  double a = 0, a_full = 0;           ///< Σa over usable and over saturated sites
  double radiance = 0, variance = 0;  ///< Σ(L − ambient), Σ variance, usable sites
  double full_radiance = 0;           ///< Σ lower bounds, saturated sites
  double a2 = 0, aL = 0, L2 = 0;      ///< for the spread: Σa², ΣaL, ΣL²

  std::int32_t sites() const { return measured + dark + saturated; }
};

/// The average of one cell. f = ΣL/Σa weighs sites by geometry alone, so noise that follows the
/// signal cannot bias it; under shot noise these are also the weights of least variance.
BrdfObservation average(const CellSum& s, double detection_sigma) {
  BrdfObservation out;
  const std::int32_t usable = s.measured + s.dark;
  if (s.saturated > usable) {
    // Most of the cell is full: the mean over all sites is at least what their bounds say.
    out.kind = BrdfObservation::Kind::above;
    out.count = s.saturated;
    out.f = (s.full_radiance + s.radiance) / (s.a_full + s.a);
    return out;
  }
  out.count = usable;
  out.f = s.radiance / s.a;
  const double noise = s.variance / (s.a * s.a);
  // Observed scatter of the sites about the mean, Σ(L − f a)² / (Σa)² · n/(n − 1); it holds the
  // noise already, so the larger of the two stands.
  double scatter = 0;
  if (usable > 1) {
    const double squares = std::max(0.0, s.L2 - 2 * out.f * s.aL + out.f * out.f * s.a2);
    scatter = squares / (s.a * s.a) * usable / (usable - 1.0);
  }
  out.variance = std::max(noise, scatter);
  if (out.f < detection_sigma * std::sqrt(out.variance)) {
    out.kind = BrdfObservation::Kind::below;
    out.f = std::max(out.f, 0.0) + detection_sigma * std::sqrt(out.variance);
  }
  return out;
}

/// Adds one site to its cell; ambient light is subtracted with its own noise.
void add_site(CellSum& sum, const RadianceImage& image, const RadianceImage* ambient,
              std::size_t site, double a) {
  double L = double{image.L[site]}, variance = double{image.variance[site]};
  bool full = image.site[site] == RadianceImage::Site::saturated;
  if (ambient != nullptr) {
    const bool ambient_full = ambient->site[site] == RadianceImage::Site::saturated;
    // Light that saturates without the lamp says nothing about the lamp.
    if (ambient_full) return;
    L -= double{ambient->L[site]};
    variance += double{ambient->variance[site]};
  }
  if (full) {
    ++sum.saturated;
    sum.a_full += a;
    sum.full_radiance += L;
    return;
  }
  image.site[site] == RadianceImage::Site::dark ? ++sum.dark : ++sum.measured;
  sum.a += a;
  sum.radiance += L;
  sum.variance += variance;
  sum.a2 += a * a;
  sum.aL += a * L;
  sum.L2 += L * L;
}

/// Channel of a site. Sites mostly come in the order of the picture: the row is that of the last.
class SiteChannel {
 public:
  explicit SiteChannel(const RadianceImage& image)
      : mono_(image.filter == ColorFilter::mono), width_(image.width) {
    for (int i = 0; i < 4 && !mono_; ++i) {
      channel_[static_cast<std::size_t>(i)] = channel_at(image.filter, i / 2, i % 2);
    }
  }
  int operator()(int site) {
    if (mono_) return 0;
    if (site < begin_ || site >= begin_ + width_) {
      row_ = site / width_;
      begin_ = row_ * width_;
    }
    return channel_[static_cast<std::size_t>(2 * (row_ % 2) + (site - begin_) % 2)];
  }

 private:
  bool mono_;
  int width_, row_ = 0, begin_ = 0;
  std::array<int, 4> channel_ = {};  ///< of a filter's four places
};

/// Footprints of at most `options.footprints` sites of every row of values, evenly over its sites.
std::vector<Footprint> footprints_of(const SiteGeometry& g, const RadianceImage& image,
                                     const std::vector<SitePoint>& sites,
                                     const std::vector<BrdfObservation>& rows,
                                     const PixelNeighbours* neighbours,
                                     const ExtractOptions& options) {
  const BivariateGrid& grid = g.cells->grid();
  const auto key = [&](int channel, int cell) {
    return static_cast<std::size_t>(channel * grid.cells() + cell);
  };
  std::vector<std::int32_t> row_of(3 * static_cast<std::size_t>(grid.cells()), -1);
  for (std::size_t i = 0; i < rows.size(); ++i) {
    if (rows[i].kind != BrdfObservation::Kind::value) continue;
    row_of[key(rows[i].channel, rows[i].cell)] = static_cast<std::int32_t>(i);
  }
  std::vector<std::int32_t> seen(rows.size(), 0);
  SiteChannel channel_of(image);
  std::vector<Footprint> out;
  for (std::size_t i = 0; i < sites.size(); ++i) {
    const SitePoint& point = sites[i];
    if (!point.lit()) continue;
    const int site = *site_of(g, static_cast<Eigen::Index>(i), image.width, image.height);
    if (image.site[static_cast<std::size_t>(site)] == RadianceImage::Site::saturated) continue;
    const int channel = channel_of(site);
    const std::int32_t row = row_of[key(channel, point.cell())];
    if (row < 0) continue;
    const auto at = static_cast<std::size_t>(row);
    const int stride = (rows[at].count + options.footprints - 1) / options.footprints;
    if (seen[at]++ % std::max(stride, 1) != 0) continue;
    Footprint footprint = footprint_of(*g.points, static_cast<Eigen::Index>(i), neighbours,
                                       *g.camera, *g.light, grid);
    footprint.row = row;
    footprint.weight =
        static_cast<float>(options.lamp_strength[channel] * double{point.irradiance});
    out.push_back(footprint);
  }
  return out;
}

/// Points by what became of them, in the order of PointState.
using StateCounts = std::array<std::int64_t, 8>;

void count(const StateCounts& states, ExtractionStatistics& out) {
  const auto of = [&](PointState state) { return states[static_cast<std::size_t>(state)]; };
  out.unlit = of(PointState::unlit);
  out.grazing = of(PointState::grazing);
  out.invalid_cell = of(PointState::invalid_cell);
  out.shadowed = of(PointState::shadowed);
  out.boundary = of(PointState::boundary);
  out.off_image = of(PointState::off_image);
  out.blocked = of(PointState::blocked);
}

/// Sums per channel and cell.
struct Sums {
  const SiteGeometry* geometry;
  const RadianceImage* image;
  const RadianceImage* ambient;
  const ExtractOptions* options;

  std::vector<CellSum> none() const {
    const std::size_t channels = image->filter == ColorFilter::mono ? 1 : 3;
    return std::vector<CellSum>(static_cast<std::size_t>(geometry->cells->grid().cells()) *
                                channels);
  }

  std::size_t site_of_point(std::size_t i) const {
    const SurfacePoints& points = *geometry->points;
    const int site = points.from_pixels ? points.source[i]
                                        : *site_of(*geometry, static_cast<Eigen::Index>(i),
                                                   image->width, image->height);
    return static_cast<std::size_t>(site);
  }

  CellSum& sum_of(const SitePoint& point, int channel, std::vector<CellSum>& sums) const {
    return sums[static_cast<std::size_t>(channel * geometry->cells->grid().cells() + point.cell())];
  }

  void add(std::size_t i, const SitePoint& point, SiteChannel& channel_of,
           std::vector<CellSum>& sums) const {
    const std::size_t site = site_of_point(i);
    const int channel = channel_of(static_cast<int>(site));
    add_site(sum_of(point, channel, sums), *image, ambient, site,
             options->lamp_strength[channel] * double{point.irradiance});
  }

  /// One after the last of the lit pixels from `begin` on that lie side by side in one row and
  /// cell.
  std::size_t end_of_run(std::size_t begin, const std::vector<SitePoint>& sites) const {
    if (!geometry->points->from_pixels) return begin + 1;
    const std::vector<int>& source = geometry->points->source;
    const int row_end = (source[begin] / image->width + 1) * image->width;
    const std::int32_t cell = sites[begin].cell();
    std::size_t end = begin + 1;
    while (end < sites.size() && sites[end].cell_or_state == cell && source[end] < row_end &&
           source[end] == source[end - 1] + 1) {
      ++end;
    }
    return end;
  }

  /// Adds the run [begin, end), each channel by itself and in the order of add(): sums that stay in
  /// registers, where those of a cell in memory would wait for each other.
  void add_run(std::size_t begin, std::size_t end, const std::vector<SitePoint>& sites,
               SiteChannel& channel_of, std::vector<CellSum>& sums) const {
    const std::size_t period = image->filter == ColorFilter::mono ? 1 : 2;
    for (std::size_t first = begin; first < std::min(begin + period, end); ++first) {
      std::size_t site = site_of_point(first);
      const int channel = channel_of(static_cast<int>(site));
      const double strength = options->lamp_strength[channel];
      CellSum& total = sum_of(sites[first], channel, sums);
      CellSum sum = total;
      for (std::size_t i = first; i < end; i += period, site += period) {
        add_site(sum, *image, ambient, site, strength * double{sites[i].irradiance});
      }
      total = sum;
    }
  }

  std::vector<CellSum> over(const std::vector<std::size_t>& points,
                            const std::vector<SitePoint>& sites) const {
    std::vector<CellSum> sums = none();
    SiteChannel channel_of(*image);
    for (const std::size_t i : points) add(i, sites[i], channel_of, sums);
    return sums;
  }

  std::vector<CellSum> over_all(const std::vector<SitePoint>& sites,
                                ExtractionStatistics& statistics) const {
    std::vector<CellSum> sums = none();
    SiteChannel channel_of(*image);
    StateCounts states = {};
    std::int64_t saturated = 0, dark = 0;
    for (std::size_t i = 0; i < sites.size();) {
      if (!sites[i].lit()) {
        ++states[static_cast<std::size_t>(sites[i++].state())];
        continue;
      }
      const std::size_t end = end_of_run(i, sites);
      std::int64_t full = 0, black = 0;
      for (std::size_t j = i; j < end; ++j) {
        const RadianceImage::Site site = image->site[site_of_point(j)];
        full += site == RadianceImage::Site::saturated;
        black += site == RadianceImage::Site::dark;
      }
      saturated += full;
      dark += black;
      add_run(i, end, sites, channel_of, sums);
      i = end;
    }
    count(states, statistics);
    statistics.saturated = saturated;
    statistics.dark = dark;
    return sums;
  }
};

/// The row of the sum at place `key`, channel · cells + cell.
BrdfObservation row_of(const CellSum& sum, std::size_t key, const BivariateGrid& grid,
                       double detection_sigma) {
  BrdfObservation row = average(sum, detection_sigma);
  row.cell = static_cast<std::int32_t>(key) % grid.cells();
  row.channel = static_cast<std::int8_t>(static_cast<std::int32_t>(key) / grid.cells());
  return row;
}

}  // namespace

BrdfObservations extract(const RadianceImage& image, const RadianceImage* ambient,
                         const SurfacePoints& points, const CameraModel& camera,
                         const LightPosition& light, const BivariateGrid& grid,
                         std::span<const std::uint8_t> valid, const Occluder& occluder,
                         const ExtractOptions& options) {
  CHECK(options.threads >= 1);
  CHECK(valid.empty() || valid.size() == static_cast<std::size_t>(grid.cells()));
  CHECK(ambient == nullptr || ambient->L.size() == image.L.size());
  const CellLookup cells(grid);
  const double tangent = std::tan(options.limits.max_theta_d);
  const SiteGeometry geometry{&points, &camera,   &light,          &cells,
                              valid,   &occluder, &options.limits, tangent * tangent};
  std::vector<SitePoint> sites = place_all(geometry, image.width, image.height, options.threads);
  std::optional<PixelNeighbours> own;
  const PixelNeighbours* neighbours = options.neighbours;
  const bool tell_blocked = points.from_pixels && options.least_f != nullptr;
  const bool needed =
      points.from_pixels && (options.drop_mixed || options.footprints > 0 || tell_blocked);
  if (needed && neighbours == nullptr) {
    neighbours = &own.emplace(points, image.width, image.height);
  }
  if (points.from_pixels && options.drop_mixed) leave_out_mixed(*neighbours, sites);

  BrdfObservations out;
  out.statistics.sites = points.size();
  const Sums sums{&geometry, &image, ambient, &options};
  std::vector<CellSum> black;
  if (tell_blocked) {
    BlackPoints found = leave_out_blocked(image, ambient, geometry, *neighbours, options, sites);
    if (!found.blocked.empty()) black = sums.over(found.blocked, sites);
    for (const std::size_t i : found.blocked) sites[i].set(PointState::blocked);
    out.doubtful = std::move(found.doubtful);
  }
  const std::vector<CellSum> lit = sums.over_all(sites, out.statistics);
  for (std::size_t i = 0; i < lit.size(); ++i) {
    if (lit[i].sites() > 0)
      out.rows.push_back(row_of(lit[i], i, grid, options.detection_sigma));
    else if (!black.empty() && black[i].sites() > 0)
      out.black.push_back(row_of(black[i], i, grid, options.detection_sigma));
  }
  if (options.footprints > 0) {
    out.footprints = footprints_of(geometry, image, sites, out.rows, neighbours, options);
  }
  return out;
}

}  // namespace lightrig
