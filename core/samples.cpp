#include "core/samples.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <optional>
#include <thread>

#include "core/cell_lookup.h"
#include "core/check.h"

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
  shadowed
};

struct SitePoint {
  PointState state = PointState::unlit;
  std::int32_t cell = 0;
  std::int32_t site = 0;  ///< row · width + column
  double irradiance = 0;  ///< falloff · cos θi, per unit of lamp strength
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

SitePoint place(const Geometry& g, Eigen::Index i, int width, int height) {
  SitePoint out;
  const Eigen::Vector3d x = g.points->position.col(i), n = g.points->normal.col(i),
                        v = g.points->view.col(i);
  const Eigen::Vector3d l = g.light->direction_from(x);
  const double cos_i = n.dot(l), cos_o = n.dot(v);
  const std::optional<std::int32_t> site = site_of(g, i, width, height);
  if (!site) {
    out.state = PointState::off_image;
    return out;
  }
  out.site = *site;
  // l = −v has no half vector; its θd is beyond any limit.
  const double sum2 = (l + v).squaredNorm();
  if (cos_i <= 0 || cos_o <= 0 || sum2 < 1e-24) return out;
  out.state = PointState::grazing;
  if (cos_i < g.limits->min_cos_i || cos_o < g.limits->min_cos_o) return out;
  if ((l - v).squaredNorm() > g.max_tangent2 * sum2) return out;
  out.cell = (*g.cells)(n, l, v);
  out.irradiance = g.light->falloff(x) * cos_i;
  const bool has_statistics = g.valid.empty() || g.valid[static_cast<std::size_t>(out.cell)] != 0;
  out.state = has_statistics ? PointState::lit : PointState::invalid_cell;
  return out;
}

/// Places a range of points and tells the shadowed ones by packets of rays.
void place_range(const Geometry& g, int width, int height, Eigen::Index begin, Eigen::Index end,
                 std::vector<SitePoint>& out) {
  std::vector<Eigen::Vector3d> position, normal;
  std::vector<std::size_t> index;
  for (Eigen::Index i = begin; i < end; ++i) {
    const SitePoint point = place(g, i, width, height);
    out[static_cast<std::size_t>(i)] = point;
    if (point.state != PointState::lit || g.occluder->convex()) continue;
    position.push_back(g.points->position.col(i));
    normal.push_back(g.points->normal.col(i));
    index.push_back(static_cast<std::size_t>(i));
  }
  std::vector<std::uint8_t> blocked(index.size(), 0);
  if (!index.empty()) g.occluder->blocked(position, normal, *g.light, blocked);
  for (std::size_t j = 0; j < index.size(); ++j) {
    if (blocked[j] != 0) out[index[j]].state = PointState::shadowed;
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

/// A pixel whose neighbourhood is not all object, or half in shadow, mixes two radiances: its
/// centre's geometry says nothing of its value. Neighbours are one point spacing away; a step in
/// depth shows as a neighbour far off the tangent plane.
class Neighbourhood {
 public:
  Neighbourhood(const SurfacePoints& points, int width, int height)
      : points_(points), width_(width), height_(height) {
    index_.assign(static_cast<std::size_t>(width) * static_cast<std::size_t>(height), -1);
    spacing_ = std::max(width, height);
    int previous_row = -1, previous_column = 0;
    for (Eigen::Index i = 0; i < points.size(); ++i) {
      const int source = points.source[static_cast<std::size_t>(i)];
      index_[static_cast<std::size_t>(source)] = static_cast<std::int32_t>(i);
      const int row = source / width, column = source % width;
      // The least step along a row is the stride the points were taken with.
      if (row == previous_row) spacing_ = std::min(spacing_, std::abs(column - previous_column));
      previous_row = row;
      previous_column = column;
    }
    spacing_ = std::max(spacing_, 1);
  }

  bool mixed(Eigen::Index i, const std::vector<SitePoint>& sites) const {
    const int source = points_.source[static_cast<std::size_t>(i)];
    const int row = source / width_, column = source % width_;
    for (int dr = -1; dr <= 1; ++dr) {
      for (int dc = -1; dc <= 1; ++dc) {
        if (dr == 0 && dc == 0) continue;
        const int r = row + dr * spacing_, c = column + dc * spacing_;
        if (r < 0 || c < 0 || r >= height_ || c >= width_) return true;
        const std::int32_t j =
            index_[static_cast<std::size_t>(r) * static_cast<std::size_t>(width_) +
                   static_cast<std::size_t>(c)];
        if (j < 0 || sites[static_cast<std::size_t>(j)].state == PointState::shadowed) return true;
        const Eigen::Vector3d step = points_.position.col(j) - points_.position.col(i);
        if (std::abs(points_.normal.col(i).dot(step)) > 0.5 * step.norm()) return true;
      }
    }
    return false;
  }

 private:
  const SurfacePoints& points_;
  int width_, height_, spacing_;
  std::vector<std::int32_t> index_;  ///< (height · width): point of a pixel, or −1
};

/// Sums over the sites of one (cell, channel). a = E cos θi, the geometry of a site.
struct CellSum {
  std::int32_t measured = 0, dark = 0, saturated = 0;
  double a = 0, a_full = 0;           ///< Σa over usable and over saturated sites
  double radiance = 0, variance = 0;  ///< Σ(L − ambient), Σ variance, usable sites
  double full_radiance = 0;           ///< Σ lower bounds, saturated sites
  double a2 = 0, aL = 0, L2 = 0;      ///< for the spread: Σa², ΣaL, ΣL²
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
    case PointState::lit:
      break;
  }
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
  if (points.from_pixels && options.drop_mixed) {
    const Neighbourhood neighbourhood(points, image.width, image.height);
    for (Eigen::Index i = 0; i < points.size(); ++i) {
      SitePoint& point = sites[static_cast<std::size_t>(i)];
      if (point.state == PointState::lit && neighbourhood.mixed(i, sites)) {
        point.state = PointState::boundary;
      }
    }
  }

  const int channels = image.filter == ColorFilter::mono ? 1 : 3;
  BrdfObservations out;
  out.statistics.sites = points.size();
  std::vector<CellSum> sums(static_cast<std::size_t>(grid.cells()) *
                            static_cast<std::size_t>(channels));
  for (const SitePoint& point : sites) {
    count(out.statistics, point.state);
    if (point.state != PointState::lit) continue;
    const int channel =
        channel_at(image.filter, point.site / image.width, point.site % image.width);
    const double a = options.lamp_strength[channel] * point.irradiance;
    const auto site = static_cast<std::size_t>(point.site);
    out.statistics.saturated += image.site[site] == RadianceImage::Site::saturated;
    out.statistics.dark += image.site[site] == RadianceImage::Site::dark;
    add_site(sums[static_cast<std::size_t>(channel * grid.cells() + point.cell)], image, ambient,
             site, a);
  }
  for (int channel = 0; channel < channels; ++channel) {
    for (int cell = 0; cell < grid.cells(); ++cell) {
      const CellSum& sum = sums[static_cast<std::size_t>(channel * grid.cells() + cell)];
      if (sum.measured + sum.dark + sum.saturated == 0) continue;
      BrdfObservation row = average(sum, options.detection_sigma);
      row.cell = cell;
      row.channel = static_cast<std::int8_t>(channel);
      out.rows.push_back(row);
    }
  }
  return out;
}

}  // namespace lightrig
