#include "core/samples.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <optional>
#include <thread>

#include "core/cell_lookup.h"
#include "core/check.h"
#include "core/pixel_neighbours.h"
#include "core/planner_kernels.h"
#include "core/site_kernels.h"

namespace lightrig {
namespace {

/// What became of a surface point on the way to a sample.
enum class PointState : std::uint8_t {
  unlit,
  grazing,
  invalid_cell,
  boundary,
  off_image,
  lit,
  shadowed,
  blocked
};

/// Small, because a picture has millions: what is not kept is found again for the lit ones.
struct SitePoint {
  std::int32_t cell_or_state = -1;  ///< the cell if lit, else −1 − state
  float irradiance = 0;             ///< falloff · cos θi, per unit of lamp strength

  void set(PointState state) { cell_or_state = -1 - static_cast<std::int32_t>(state); }
  bool lit() const { return cell_or_state >= 0; }
  PointState state() const {
    return lit() ? PointState::lit : static_cast<PointState>(-1 - cell_or_state);
  }
  int cell() const { return cell_or_state; }
};

struct Geometry {
  const SurfacePoints* points = nullptr;
  const CameraModel* camera = nullptr;
  const LightPosition* light = nullptr;
  const CellLookup* cells = nullptr;
  std::span<const std::uint8_t> valid;
  const Occluder* occluder = nullptr;
  const GrazingLimits* limits = nullptr;
  double max_tangent2 = 0;  ///< tan² of the largest θd
};

/// The site that records a point: its own pixel, or the one it projects into.
std::optional<std::int32_t> site_of(const Geometry& g, Eigen::Index i, int width, int height) {
  if (g.points->from_pixels) return g.points->source[static_cast<std::size_t>(i)];
  const Eigen::Vector2d uv = project(*g.camera, g.points->position.col(i));
  if (!uv.allFinite()) return std::nullopt;
  const double column = std::round(uv.x()), row = std::round(uv.y());
  if (column < 0 || row < 0 || column >= width || row >= height) return std::nullopt;
  return static_cast<std::int32_t>(row) * width + static_cast<std::int32_t>(column);
}

/// What point i of a run that begins at `first` is, from the run's angles.
SitePoint place(const Geometry& g, Eigen::Index first, std::size_t i, const SiteAngles& angles,
                int width, int height) {
  SitePoint out;
  out.set(PointState::off_image);
  const Eigen::Index at = first + static_cast<Eigen::Index>(i);
  if (!g.points->from_pixels && !site_of(g, at, width, height)) return out;
  out.set(PointState::unlit);
  // l = −v has no half vector; its θd is beyond any limit.
  const double sum2 = angles.sum2[i];
  if (angles.cos_i[i] <= 0 || angles.cos_o[i] <= 0 || sum2 < 1e-24) return out;
  const Eigen::Vector3d x = g.points->position.col(at);
  const bool whole_sphere = g.light->distant || g.light->lobe.uniform();
  if (!whole_sphere && !g.light->reaches(x)) return out;
  out.set(PointState::grazing);
  if (angles.cos_i[i] < g.limits->min_cos_i || angles.cos_o[i] < g.limits->min_cos_o) return out;
  if (angles.difference2[i] > g.max_tangent2 * sum2) return out;
  const int cell = g.cells->grid().cell(g.cells->row(angles.chord2[i]),
                                        g.cells->column(angles.difference2[i] / sum2));
  out.set(PointState::invalid_cell);
  if (!g.valid.empty() && g.valid[static_cast<std::size_t>(cell)] == 0) return out;
  out.cell_or_state = cell;
  const double emitted = whole_sphere ? 1.0 : g.light->emission(x);
  out.irradiance = static_cast<float>(angles.irradiance[i] * emitted);
  return out;
}

/// Places a range of points and tells the shadowed ones by packets of rays.
void place_range(const Geometry& g, int width, int height, Eigen::Index begin, Eigen::Index end,
                 std::vector<SitePoint>& out) {
  std::vector<Eigen::Vector3d> position, normal;
  std::vector<std::size_t> index;
  const bool convex = g.occluder->convex();
  const int level = vector_level();
  SiteAngles angles;
  for (Eigen::Index first = begin; first < end;
       first += static_cast<Eigen::Index>(SiteAngles::size)) {
    const auto n = static_cast<std::size_t>(
        std::min(end - first, static_cast<Eigen::Index>(SiteAngles::size)));
    angles_of_sites(g.points->position.col(first).data(), g.points->normal.col(first).data(),
                    g.points->view.col(first).data(), n, *g.light, angles, level);
    for (std::size_t i = 0; i < n; ++i) {
      const SitePoint point = place(g, first, i, angles, width, height);
      const Eigen::Index at = first + static_cast<Eigen::Index>(i);
      out[static_cast<std::size_t>(at)] = point;
      if (!point.lit() || convex) continue;
      position.push_back(g.points->position.col(at));
      normal.push_back(g.points->normal.col(at));
      index.push_back(static_cast<std::size_t>(at));
    }
  }
  std::vector<std::uint8_t> blocked(index.size(), 0);
  if (!index.empty()) g.occluder->blocked(position, normal, *g.light, blocked);
  for (std::size_t j = 0; j < index.size(); ++j) {
    if (blocked[j] != 0) out[index[j]].set(PointState::shadowed);
  }
}

std::vector<SitePoint> place_all(const Geometry& g, int width, int height, int threads) {
  const Eigen::Index n = g.points->size();
  std::vector<SitePoint> out(static_cast<std::size_t>(n));
  std::vector<std::jthread> others;
  for (int t = 1; t < threads; ++t) {
    others.emplace_back([&g, &out, width, height, n, t, threads] {
      place_range(g, width, height, n * t / threads, n * (t + 1) / threads, out);
    });
  }
  place_range(g, width, height, 0, n / threads, out);
  return out;
}

/// Marks lit pixels that mix two radiances: their centre's geometry says nothing of their value.
void leave_out_mixed(const PixelNeighbours& neighbours, std::vector<SitePoint>& sites) {
  std::vector<std::uint8_t> shadowed(sites.size());
  for (std::size_t i = 0; i < sites.size(); ++i) {
    shadowed[i] = sites[i].state() == PointState::shadowed ? 1 : 0;
  }
  for (std::size_t i = 0; i < sites.size(); ++i) {
    if (!sites[i].lit()) continue;
    const auto at = static_cast<Eigen::Index>(i);
    if (!neighbours.whole(at) || neighbours.beside(at, shadowed)) {
      sites[i].set(PointState::boundary);
    }
  }
}

/// Marks as blocked the lit pixels that are black where even the darkest known material would not
/// be, and leaves out those beside them, which may be half black. Returns the marked points.
std::vector<std::size_t> leave_out_blocked(const RadianceImage& image, const RadianceImage* ambient,
                                           const Geometry& g, const PixelNeighbours& neighbours,
                                           const ExtractOptions& options,
                                           std::vector<SitePoint>& sites) {
  const bool mono = image.filter == ColorFilter::mono;
  std::vector<std::uint8_t> black(sites.size(), 0);
  std::vector<std::size_t> found;
  for (std::size_t i = 0; i < sites.size(); ++i) {
    if (!sites[i].lit()) continue;
    const int site = g.points->source[i];
    const auto at = static_cast<std::size_t>(site);
    if (image.site[at] == RadianceImage::Site::saturated) continue;
    double L = double{image.L[at]}, variance = double{image.variance[at]};
    if (ambient != nullptr) {
      if (ambient->site[at] == RadianceImage::Site::saturated) continue;
      L -= double{ambient->L[at]};
      variance += double{ambient->variance[at]};
    }
    const double noise = options.detection_sigma * std::sqrt(variance);
    if (L >= noise) continue;
    const int channel = mono ? 0 : channel_at(image.filter, site / image.width, site % image.width);
    const double least = (*options.least_f)(
        sites[i].cell(), std::min<Eigen::Index>(channel, options.least_f->cols() - 1));
    if (least * options.lamp_strength[channel] * double{sites[i].irradiance} < 3 * noise) continue;
    black[i] = 1;
    found.push_back(i);
  }
  if (found.empty()) return found;
  for (std::size_t i = 0; i < sites.size(); ++i) {
    if (sites[i].lit() && black[i] == 0 && neighbours.beside(static_cast<Eigen::Index>(i), black)) {
      sites[i].set(PointState::boundary);
    }
  }
  return found;
}

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

/// Footprints of at most `options.footprints` sites of every row of values, evenly over its sites.
std::vector<Footprint> footprints_of(const Geometry& g, const RadianceImage& image,
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
  std::vector<Footprint> out;
  for (std::size_t i = 0; i < sites.size(); ++i) {
    const SitePoint& point = sites[i];
    if (!point.lit()) continue;
    const int site = *site_of(g, static_cast<Eigen::Index>(i), image.width, image.height);
    if (image.site[static_cast<std::size_t>(site)] == RadianceImage::Site::saturated) continue;
    const int channel = channel_at(image.filter, site / image.width, site % image.width);
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

void count(ExtractionStatistics& s, PointState state) {
  switch (state) {
    case PointState::unlit:
      ++s.unlit;
      break;
    case PointState::grazing:
      ++s.grazing;
      break;
    case PointState::invalid_cell:
      ++s.invalid_cell;
      break;
    case PointState::shadowed:
      ++s.shadowed;
      break;
    case PointState::boundary:
      ++s.boundary;
      break;
    case PointState::off_image:
      ++s.off_image;
      break;
    case PointState::blocked:
      ++s.blocked;
      break;
    case PointState::lit:
      break;
  }
}

/// Sums per channel and cell.
struct Sums {
  const Geometry* geometry;
  const RadianceImage* image;
  const RadianceImage* ambient;
  const ExtractOptions* options;

  std::vector<CellSum> none() const {
    const std::size_t channels = image->filter == ColorFilter::mono ? 1 : 3;
    return std::vector<CellSum>(static_cast<std::size_t>(geometry->cells->grid().cells()) *
                                channels);
  }

  /// Adds point i; returns its site.
  std::size_t add(std::size_t i, const SitePoint& point, std::vector<CellSum>& sums) const {
    const int site = *site_of(*geometry, static_cast<Eigen::Index>(i), image->width, image->height);
    const int channel = image->filter == ColorFilter::mono
                            ? 0
                            : channel_at(image->filter, site / image->width, site % image->width);
    const double a = options->lamp_strength[channel] * double{point.irradiance};
    const auto key =
        static_cast<std::size_t>(channel * geometry->cells->grid().cells() + point.cell());
    add_site(sums[key], *image, ambient, static_cast<std::size_t>(site), a);
    return static_cast<std::size_t>(site);
  }

  std::vector<CellSum> over(const std::vector<std::size_t>& points,
                            const std::vector<SitePoint>& sites) const {
    std::vector<CellSum> sums = none();
    for (const std::size_t i : points) add(i, sites[i], sums);
    return sums;
  }

  std::vector<CellSum> over_all(const std::vector<SitePoint>& sites,
                                ExtractionStatistics& statistics) const {
    std::vector<CellSum> sums = none();
    for (std::size_t i = 0; i < sites.size(); ++i) {
      count(statistics, sites[i].state());
      if (!sites[i].lit()) continue;
      const std::size_t site = add(i, sites[i], sums);
      statistics.saturated += image->site[site] == RadianceImage::Site::saturated;
      statistics.dark += image->site[site] == RadianceImage::Site::dark;
    }
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
  const Geometry geometry{&points, &camera,   &light,          &cells,
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
    const std::vector<std::size_t> blocked =
        leave_out_blocked(image, ambient, geometry, *neighbours, options, sites);
    if (!blocked.empty()) black = sums.over(blocked, sites);
    for (const std::size_t i : blocked) sites[i].set(PointState::blocked);
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
