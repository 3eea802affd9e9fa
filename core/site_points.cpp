#include "core/site_points.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <thread>
#include <utility>

#include "core/planner_kernels.h"
#include "core/site_kernels.h"

namespace lightrig {

std::optional<std::int32_t> site_of(const SiteGeometry& g, Eigen::Index i, int width, int height) {
  if (g.points->from_pixels) return g.points->source[static_cast<std::size_t>(i)];
  const Eigen::Vector2d uv = project(*g.camera, g.points->position.col(i));
  if (!uv.allFinite()) return std::nullopt;
  const double column = std::round(uv.x()), row = std::round(uv.y());
  if (column < 0 || row < 0 || column >= width || row >= height) return std::nullopt;
  return static_cast<std::int32_t>(row) * width + static_cast<std::int32_t>(column);
}

namespace {

/// What point i of a run that begins at `first` is, from the run's angles. `everywhere`: the lamp
/// sends alike all round, so that where the point lies is not asked.
SitePoint place(const SiteGeometry& g, Eigen::Index first, std::size_t i, const SiteAngles& angles,
                bool everywhere, int width, int height) {
  SitePoint out;
  out.set(PointState::off_image);
  const Eigen::Index at = first + static_cast<Eigen::Index>(i);
  if (!g.points->from_pixels && !site_of(g, at, width, height)) return out;
  out.set(PointState::unlit);
  const double chord2 = angles.chord2[i];
  if (chord2 == SiteAngles::unlit) return out;
  if (!everywhere && !g.light->reaches(g.points->position.col(at))) return out;
  out.set(PointState::grazing);
  if (chord2 == SiteAngles::grazing) return out;
  const int cell = g.cells->grid().cell(g.cells->row(chord2), g.cells->column(angles.tangent2[i]));
  out.set(PointState::invalid_cell);
  if (!g.valid.empty() && g.valid[static_cast<std::size_t>(cell)] == 0) return out;
  out.cell_or_state = cell;
  double irradiance = angles.irradiance[i];
  if (!everywhere) irradiance *= g.light->emission(g.points->position.col(at));
  out.irradiance = static_cast<float>(irradiance);
  return out;
}

/// Has eight points from `at` on brought near: their numbers lie in memory, and waiting for them is
/// most of what an angle costs.
/// Inlined, since a function that only fetches is taken for one that does nothing.
[[gnu::always_inline]] inline void fetch_points(const SurfacePoints& points, Eigen::Index at) {
  if (at + 8 > points.size()) return;
  for (const Eigen::Matrix3Xd* numbers : {&points.position, &points.normal, &points.view}) {
    const double* const first = numbers->col(at).data();
    for (int i = 0; i < 24; i += 8) __builtin_prefetch(first + i);
  }
}

/// Places a run and has the next one fetched. Neighbouring pixels mostly share their cell: the last
/// one's is tried first, where nothing else can keep a point out of it.
void place_run(const SiteGeometry& g, Eigen::Index first, std::size_t count,
               const SiteAngles& angles, int width, int height, SitePoint* out) {
  const bool everywhere = g.light->distant || g.light->lobe.uniform();
  const bool by_angles_alone = everywhere && g.points->from_pixels;
  double row_begin = 1, row_end = 0, column_begin = 0, column_end = 0;  // of no cell yet
  std::int32_t cell = 0;
  for (std::size_t i = 0; i < count; ++i) {
    if (i % 8 == 0)
      fetch_points(*g.points, first + static_cast<Eigen::Index>(SiteAngles::size + i));
    const double chord2 = angles.chord2[i], tangent2 = angles.tangent2[i];
    if ((chord2 >= row_begin) & (chord2 < row_end) & (tangent2 >= column_begin) &
        (tangent2 < column_end)) {
      out[i].cell_or_state = cell;
      out[i].irradiance = static_cast<float>(angles.irradiance[i]);
      continue;
    }
    if (by_angles_alone && chord2 < 0) {
      out[i].set(chord2 == SiteAngles::unlit ? PointState::unlit : PointState::grazing);
      continue;
    }
    out[i] = place(g, first, i, angles, everywhere, width, height);
    if (!by_angles_alone || !out[i].lit()) continue;
    cell = out[i].cell();
    const int row = g.cells->grid().row_h(cell), column = g.cells->grid().column_d(cell);
    row_begin = g.cells->row_begin(row);
    row_end = g.cells->row_begin(row + 1);
    column_begin = g.cells->column_begin(column);
    column_end = g.cells->column_begin(column + 1);
  }
}

/// Places a range of points and tells the shadowed ones by packets of rays.
void place_range(const SiteGeometry& g, int width, int height, Eigen::Index begin, Eigen::Index end,
                 std::vector<SitePoint>& out) {
  std::vector<Eigen::Vector3d> position, normal;
  std::vector<std::size_t> index;
  const bool convex = g.occluder->convex();
  const SiteLimits limits{g.limits->min_cos_i, g.limits->min_cos_o, g.max_tangent2};
  const int level = vector_level();
  SiteAngles angles;
  for (Eigen::Index first = begin; first < end;
       first += static_cast<Eigen::Index>(SiteAngles::size)) {
    const auto n = static_cast<std::size_t>(
        std::min(end - first, static_cast<Eigen::Index>(SiteAngles::size)));
    angles_of_sites(g.points->position.col(first).data(), g.points->normal.col(first).data(),
                    g.points->view.col(first).data(), n, *g.light, limits, angles, level);
    SitePoint* run = out.data() + first;
    place_run(g, first, n, angles, width, height, run);
    for (std::size_t i = 0; i < n && !convex; ++i) {
      if (!run[i].lit()) continue;
      const Eigen::Index at = first + static_cast<Eigen::Index>(i);
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

}  // namespace

std::vector<SitePoint> place_all(const SiteGeometry& g, int width, int height, int threads) {
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

void leave_out_mixed(const PixelNeighbours& neighbours, std::vector<SitePoint>& sites) {
  std::vector<std::uint8_t> shadowed(sites.size());
  for (std::size_t i = 0; i < sites.size(); ++i) {
    shadowed[i] = sites[i].state() == PointState::shadowed ? 1 : 0;
  }
  const std::vector<std::uint8_t> edge = neighbours.beside(shadowed);
  for (std::size_t i = 0; i < sites.size(); ++i) {
    if (!sites[i].lit()) continue;
    if (edge[i] != 0 || !neighbours.whole(static_cast<Eigen::Index>(i))) {
      sites[i].set(PointState::boundary);
    }
  }
}

BlackPoints leave_out_blocked(const RadianceImage& image, const RadianceImage* ambient,
                              const SiteGeometry& g, const PixelNeighbours& neighbours,
                              const ExtractOptions& options, std::vector<SitePoint>& sites) {
  const bool mono = image.filter == ColorFilter::mono;
  std::vector<std::uint8_t> black(sites.size(), 0);
  std::map<std::pair<int, int>, BlackSites> doubtful;  // by channel and cell
  BlackPoints out;
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
    const double telling =
        3 * noise / (options.lamp_strength[channel] * double{sites[i].irradiance});
    if (least < telling) {
      BlackSites& same = doubtful[{channel, sites[i].cell()}];
      same.telling_f = same.count == 0 ? telling : std::min(same.telling_f, telling);
      ++same.count;
      continue;
    }
    black[i] = 1;
    out.blocked.push_back(i);
  }
  for (const auto& [key, same] : doubtful) {
    out.doubtful.push_back(
        {key.second, static_cast<std::int8_t>(key.first), same.count, same.telling_f});
  }
  if (out.blocked.empty()) return out;
  const std::vector<std::uint8_t> half_black = neighbours.beside(black);
  for (std::size_t i = 0; i < sites.size(); ++i) {
    if (half_black[i] != 0 && black[i] == 0 && sites[i].lit()) sites[i].set(PointState::boundary);
  }
  return out;
}

}  // namespace lightrig
