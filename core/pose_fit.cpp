#include "core/pose_fit.h"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
#include <numbers>

#include "core/half_diff.h"
#include "core/parallel.h"

namespace lightrig {
namespace {

using Vector6 = Eigen::Matrix<double, 6, 1>;
using Matrix6 = Eigen::Matrix<double, 6, 6>;

constexpr int knots = 32;  // of the function of θh, even in √θh: fine at the highlight
constexpr float highlight_knot = 0.35F * (knots - 1);  // 11°
constexpr int columns = knots + 2;  // and a constant on the object, and one everywhere
constexpr double unit_turn = std::numbers::pi / 180;
constexpr double unit_shift = 0.02;  // of the object's size
// Half of the difference quotients' steps [units]. A shift along the line of
// sight moves rims by a fraction of a pixel only: a small step would drown in
// the samples' grain, and be shrunk by it.
constexpr double step_turn = 0.5, step_shift = 1;
constexpr double least_step = 0.03;    // [units] below which the search is over
constexpr double longest_step = 3;     // [units] of one iteration
constexpr double prior = 10;           // [units] so that what is not seen stays zero
constexpr double seen_within = 0.12;   // [units] standard error of a direction that counts as seen
constexpr double model_error = 0.04;   // of a block's value: what one function of θh cannot say
constexpr double coarse_error = 0.2;   // the same while the pose is still far off
constexpr double floor_share = 0.004;  // of the brightest
constexpr double huber = 2;            // [sigma]
constexpr double shared_error = 4;     // neighbouring blocks err alike: so many count as one
constexpr double worst_unexplained = 0.35;
constexpr int fewest_blocks = 400;  // on the object
constexpr int iterations = 8;

/// Part of the picture that is looked at, joined to square blocks.
struct Blocks {
  int edge = 1, left = 0, top = 0, across = 0, down = 0;  // [px], blocks

  int count() const { return across * down; }
};

struct Box {
  Eigen::Vector3d middle;
  double size = 0;  // longest edge
};

Box box_of(const Mesh& mesh) {
  const Eigen::Vector3d low = mesh.vertices.rowwise().minCoeff();
  const Eigen::Vector3d high = mesh.vertices.rowwise().maxCoeff();
  return {(low + high) / 2, (high - low).maxCoeff()};
}

Blocks blocks_of(const Mesh& mesh, const CameraModel& camera, int most) {
  double left = camera.width, right = -1, top = camera.height, bottom = -1;
  for (Eigen::Index i = 0; i < mesh.vertices.cols(); ++i) {
    const Eigen::Vector2d p = project(camera, mesh.vertices.col(i));
    if (!p.allFinite()) continue;
    left = std::min(left, p.x());
    right = std::max(right, p.x());
    top = std::min(top, p.y());
    bottom = std::max(bottom, p.y());
  }
  const double margin = 0.04 * std::max(right - left, bottom - top) + 2;
  const auto inside = [](double value, int size) {
    return static_cast<int>(std::clamp(value, 0.0, double{1} * size));
  };
  Blocks blocks;
  blocks.left = inside(left - margin, camera.width);
  blocks.top = inside(top - margin, camera.height);
  const int width = inside(right + margin + 1, camera.width) - blocks.left;
  const int height = inside(bottom + margin + 1, camera.height) - blocks.top;
  if (width <= 0 || height <= 0) return blocks;
  while ((width / blocks.edge) * (height / blocks.edge) > most) ++blocks.edge;
  blocks.across = width / blocks.edge;
  blocks.down = height / blocks.edge;
  return blocks;
}

/// Turn and shift of the object in units.
Eigen::Isometry3d motion_of(const Vector6& units, const Box& box) {
  const Eigen::Vector3d turn = unit_turn * units.head<3>();
  Eigen::Isometry3d motion = Eigen::Isometry3d::Identity();
  motion.translate(box.middle + unit_shift * box.size * units.tail<3>());
  if (turn.norm() > 0) motion.rotate(Eigen::AngleAxisd(turn.norm(), turn.normalized()));
  motion.translate(-box.middle);
  return motion;
}

/// What the picture is made of at one pose: value = columns · (function of θh,
/// constants).
struct Rendered {
  Eigen::MatrixXf shares;   // (blocks × columns)
  Eigen::VectorXf covered;  // (blocks) [0, 1]
};

class Painter {
 public:
  Painter(const Mesh& mesh, const Occluder& occluder, const CameraModel& camera,
          const LightPosition& light, const Blocks& blocks, int threads)
      : mesh_(mesh),
        occluder_(occluder),
        camera_(camera),
        light_(light),
        blocks_(blocks),
        threads_(threads),
        convex_(occluder.convex()) {}

  /// The object moved is camera and lamp moved the other way.
  Rendered at(const Eigen::Isometry3d& motion) const;

 private:
  struct Sight {
    CameraModel camera;
    LightPosition light;
  };
  struct Sample {
    bool hit = false;
    float irradiance = 0;  // E cos θi: 0 where unlit
    float knot = 0;        // [0, knots − 1]
  };
  Sample sample(const Sight& sight, double u, double v) const;
  void paint(const Sight& sight, int block, Rendered& out) const;

  const Mesh& mesh_;
  const Occluder& occluder_;
  const CameraModel& camera_;
  const LightPosition& light_;
  const Blocks blocks_;
  const int threads_;
  const bool convex_;
};

Painter::Sample Painter::sample(const Sight& sight, double u, double v) const {
  Sample out;
  const Ray ray = ray_through(sight.camera, u, v);
  const auto hit = occluder_.first_hit(ray);
  if (!hit) return out;
  out.hit = true;
  const Eigen::Vector3i corner = mesh_.triangles.col(hit->triangle);
  const double w = 1 - hit->u - hit->v;
  const Eigen::Vector3d x = ray.origin + hit->distance * ray.direction;
  const Eigen::Vector3d n =
      (w * mesh_.normals.col(corner[0]) + hit->u * mesh_.normals.col(corner[1]) +
       hit->v * mesh_.normals.col(corner[2]))
          .normalized();
  const Eigen::Vector3d l = sight.light.direction_from(x);
  const double cos_i = n.dot(l);
  if (!(cos_i > 0) || n.dot(ray.direction) >= 0) return out;
  if (!convex_ && occluder_.blocked(x, n, sight.light)) return out;
  const Eigen::Vector3d h = (l - ray.direction).normalized();
  const double theta = theta_of_half_chord2(half_chord2(n.x(), n.y(), n.z(), h.x(), h.y(), h.z()));
  out.irradiance = static_cast<float>(sight.light.falloff(x) * cos_i);
  out.knot =
      static_cast<float>(std::sqrt(std::min(1.0, theta / (std::numbers::pi / 2))) * (knots - 1));
  return out;
}

/// Where in the block's n × n parts the samples lie: the same at every pose,
/// and no two blocks alike, so that rims meet no regular grid.
double jitter(int block, int sample, std::uint32_t salt) {
  auto z = static_cast<std::uint32_t>(block) * 2654435761U +
           static_cast<std::uint32_t>(sample) * 40503U + salt;
  z = (z ^ (z >> 15U)) * 2246822519U;
  z = (z ^ (z >> 13U)) * 3266489917U;
  return (z >> 8U) * 0x1p-24;
}

/// Four samples a block, nine in a highlight, and 36 where they differ in what
/// they see: at rims and shadows.
void Painter::paint(const Sight& sight, int block, Rendered& out) const {
  const double left = blocks_.left + (block % blocks_.across) * blocks_.edge - 0.5;
  const double top = blocks_.top + (block / blocks_.across) * blocks_.edge - 0.5;
  std::array<Sample, 36> samples;
  const auto take = [&](int n) {
    for (int i = 0; i < n * n; ++i)
      samples[static_cast<std::size_t>(i)] =
          sample(sight, left + (i % n + jitter(block, i, 1)) / n * blocks_.edge,
                 top + (i / n + jitter(block, i, 7)) / n * blocks_.edge);
    return n * n;
  };
  int count = take(2);
  const auto first = samples.begin(), last = samples.begin() + count;
  const bool mixed = std::any_of(first, last, [&](const Sample& s) {
    return s.hit != samples[0].hit || (s.irradiance > 0) != (samples[0].irradiance > 0);
  });
  const bool highlight = std::any_of(
      first, last, [](const Sample& s) { return s.irradiance > 0 && s.knot < highlight_knot; });
  if (mixed) {
    count = take(6);
  } else if (highlight) {
    count = take(3);
  }
  const float share = 1.0F / static_cast<float>(count);
  out.shares.row(block).setZero();
  out.covered[block] = 0;
  for (int i = 0; i < count; ++i) {
    const Sample& s = samples[static_cast<std::size_t>(i)];
    if (!s.hit) continue;
    out.covered[block] += share;
    const int knot = std::min(knots - 2, static_cast<int>(s.knot));
    const float along = s.knot - static_cast<float>(knot);
    out.shares(block, knot) += share * s.irradiance * (1 - along);
    out.shares(block, knot + 1) += share * s.irradiance * along;
  }
  out.shares(block, knots) = out.covered[block];
  out.shares(block, knots + 1) = 1;
}

Rendered Painter::at(const Eigen::Isometry3d& motion) const {
  Sight sight{camera_, light_};
  sight.camera.camera_from_world = camera_.camera_from_world * motion;
  const Eigen::Isometry3d back = motion.inverse();
  sight.light.p = light_.distant ? Eigen::Vector3d(back.linear() * light_.p) : back * light_.p;
  sight.light.aim = back.linear() * light_.aim;
  Rendered out{Eigen::MatrixXf(blocks_.count(), columns), Eigen::VectorXf(blocks_.count())};
  parallel_ranges(blocks_.count(), 64, threads_, [&](std::int64_t first, std::int64_t last, int) {
    for (std::int64_t block = first; block < last; ++block)
      paint(sight, static_cast<int>(block), out);
  });
  return out;
}

/// The picture's values in blocks; those with a pixel that has no value have
/// none.
struct Values {
  Eigen::VectorXd value, variance;
};

Values joined(const LitPicture& picture, const Blocks& blocks) {
  Values out{Eigen::VectorXd::Zero(blocks.count()), Eigen::VectorXd::Zero(blocks.count())};
  const double pixels = blocks.edge * blocks.edge;
  for (int block = 0; block < blocks.count(); ++block) {
    for (int i = 0; i < blocks.edge * blocks.edge; ++i) {
      const int x = blocks.left + (block % blocks.across) * blocks.edge + i % blocks.edge;
      const int y = blocks.top + (block / blocks.across) * blocks.edge + i / blocks.edge;
      const auto at = static_cast<std::size_t>(y) * static_cast<std::size_t>(picture.width) +
                      static_cast<std::size_t>(x);
      out.value[block] += double{picture.value[at]} / pixels;
      out.variance[block] += double{picture.variance[at]} / (pixels * pixels);
    }
  }
  return out;
}

/// The state of the search.
struct Search {
  const Painter& painter;
  const Box& box;
  const Values& values;
  double floor = 0;             // variance of what nothing can say
  double doubt = coarse_error;  // share of a value by which the model may be wrong

  Vector6 units = Vector6::Zero();
  Matrix6 information = Matrix6::Zero();  // of the units, the function of θh projected out
  double unexplained = 1;
  Eigen::VectorXd surface = Eigen::VectorXd::Zero(columns);  // the function of θh, and constants

  Rendered rendered(const Vector6& at) const { return painter.at(motion_of(at, box)); }
  Eigen::VectorXd weights(const Eigen::VectorXd& explained) const;
  void solve_surface(const Rendered& here);
  void improve(const Rendered& here);
};

Eigen::VectorXd Search::weights(const Eigen::VectorXd& explained) const {
  Eigen::VectorXd w(values.value.size());
  for (Eigen::Index i = 0; i < w.size(); ++i) {
    const double sigma = std::sqrt(values.variance[i] + floor +
                                   std::pow(model_error * std::max(0.0, explained[i]), 2));
    const double off = std::abs(values.value[i] - explained[i]) / sigma;
    w[i] =
        std::isfinite(sigma) ? std::min(1.0, huber / std::max(off, 1e-9)) / (sigma * sigma) : 0.0;
  }
  return w;
}

// A touch of ridge, for knots that no point of the surface reaches.
Eigen::MatrixXd with_ridge(Eigen::MatrixXd normal) {
  for (Eigen::Index i = 0; i < normal.rows(); ++i)
    normal(i, i) += 1e-9 * normal.diagonal().maxCoeff() + std::numeric_limits<double>::min();
  return normal;
}

/// The function of θh that explains the picture best at this pose.
void Search::solve_surface(const Rendered& here) {
  const Eigen::MatrixXd a = here.shares.cast<double>();
  for (int round = 0; round < 3; ++round) {
    const Eigen::VectorXd w = weights(round == 0 && surface.isZero() ? values.value : a * surface);
    const Eigen::MatrixXd wa = w.asDiagonal() * a;
    surface = with_ridge(a.transpose() * wa).ldlt().solve(wa.transpose() * values.value);
  }
}

/// One step of Gauss–Newton.
void Search::improve(const Rendered& here) {
  solve_surface(here);
  const Eigen::MatrixXd a = here.shares.cast<double>();
  const Eigen::VectorXd explained = a * surface;
  Eigen::MatrixXd j(values.value.size(), 6);
  for (Eigen::Index k = 0; k < 6; ++k) {
    const double step = k < 3 ? step_turn : step_shift;
    const Rendered ahead = rendered(units + step * Vector6::Unit(k));
    const Rendered behind = rendered(units - step * Vector6::Unit(k));
    j.col(k) = (ahead.shares - behind.shares).cast<double>() * surface / (2 * step);
  }
  const Eigen::VectorXd w = weights(explained), left = values.value - explained;
  const Eigen::MatrixXd wa = w.asDiagonal() * a, wj = w.asDiagonal() * j;
  const Eigen::LDLT<Eigen::MatrixXd> surface_normal(with_ridge(a.transpose() * wa));
  const Eigen::MatrixXd hidden = surface_normal.solve(wa.transpose() * j);
  information = j.transpose() * wj - (j.transpose() * wa) * hidden;
  const Vector6 right = wj.transpose() * left - hidden.transpose() * (wa.transpose() * left);
  const double freedom = std::max(1.0, static_cast<double>((w.array() > 0).count()) - columns - 6);
  const double scatter = std::max(1.0, left.cwiseAbs2().dot(w) / freedom) * shared_error;
  information /= scatter;
  const Matrix6 normal = information + Matrix6::Identity() / (prior * prior);
  Vector6 move = normal.ldlt().solve(right / scatter - units / (prior * prior));
  move *= std::min(1.0, longest_step / std::max(move.norm(), 1e-12));
  units += move;
}

double share_unexplained(const Values& values, const Eigen::VectorXd& explained) {
  double left = 0, all = 0;
  for (Eigen::Index i = 0; i < explained.size(); ++i) {
    if (!std::isfinite(values.variance[i])) continue;
    left += std::pow(values.value[i] - explained[i], 2);
    all += std::pow(values.value[i], 2);
  }
  return all > 0 ? std::sqrt(left / all) : 1;
}

double shared_area(const Eigen::VectorXf& a, const Eigen::VectorXf& b) {
  return double{a.cwiseMin(b).sum()} / std::max(1.0, double{a.cwiseMax(b).sum()});
}

}  // namespace

PoseFit fit_pose(const LitPicture& picture, const Mesh& mesh, const Occluder& occluder,
                 const CameraModel& camera, const LightPosition& light, int threads,
                 int most_blocks) {
  PoseFit out;
  const Blocks blocks = blocks_of(mesh, camera, most_blocks);
  if (blocks.count() < fewest_blocks) return out;
  const Box box = box_of(mesh);
  const Values values = joined(picture, blocks);
  const Painter painter(mesh, occluder, camera, light, blocks, threads);
  double brightest = 0;
  for (Eigen::Index i = 0; i < values.value.size(); ++i)
    if (std::isfinite(values.variance[i])) brightest = std::max(brightest, values.value[i]);
  Search search{painter, box, values, std::pow(floor_share * brightest, 2)};
  const Rendered modelled = search.rendered(search.units);
  const auto lit = (modelled.shares.leftCols(knots).rowwise().sum().array() > 0).count();
  out.blocks = static_cast<int>(lit);
  if (lit < fewest_blocks || !(brightest > 0)) return out;
  Rendered here = modelled;
  for (int i = 0; i < iterations; ++i) {
    const Vector6 before = search.units;
    search.improve(here);
    here = search.rendered(search.units);
    const double moved = (search.units - before).norm();
    if (search.doubt == model_error && moved < least_step) break;
    if (moved < 4 * least_step || i >= 2) search.doubt = model_error;
  }
  search.solve_surface(here);
  out.unexplained = share_unexplained(values, here.shares.cast<double>() * search.surface);
  out.told = out.unexplained < worst_unexplained;
  out.turn = unit_turn * search.units.head<3>();
  out.shift = unit_shift * box.size * search.units.tail<3>();
  out.overlap = shared_area(modelled.covered, here.covered);
  const Eigen::SelfAdjointEigenSolver<Matrix6> axes(search.information);
  for (Eigen::Index i = 0; i < 6; ++i) {
    if (axes.eigenvalues()[i] * seen_within * seen_within < 1) continue;
    ++out.directions_seen;
    const Vector6 axis = axes.eigenvectors().col(i);
    out.off += axis * axis.dot(search.units);
  }
  return out;
}

}  // namespace lightrig
