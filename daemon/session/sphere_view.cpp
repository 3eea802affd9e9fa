#include "daemon/session/sphere_view.h"

#include <Eigen/Geometry>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <thread>

#include "core/check.h"
#include "daemon/session/brdf_lookup.h"

namespace lightrig {
namespace {

// Half vectors near the normal are a highlight's business and cover little solid angle: few
// azimuths each. Further out two rows of the table share a ring.
constexpr int rows_alone = 30;
constexpr int most_azimuths = 40;
constexpr int columns = 256;
// Successive rings of half vectors are turned by the golden angle, lest their samples line up.
constexpr double golden_angle = 2.399963229728653;

// Octahedral coordinates in 0 … 1 of a direction [Meyer 2010].
Eigen::Array2f octahedral(const Eigen::Vector3f& d) {
  const float norm = d.cwiseAbs().sum();
  float x = d.x() / norm, y = d.y() / norm;
  if (d.z() < 0) {
    const float folded_x = (1 - std::abs(y)) * (x >= 0 ? 1.0F : -1.0F);
    y = (1 - std::abs(x)) * (y >= 0 ? 1.0F : -1.0F);
    x = folded_x;
  }
  return {0.5F * (x + 1), 0.5F * (y + 1)};
}

Eigen::Vector3d direction_at(double u, double v) {
  const double x = 2 * u - 1, y = 2 * v - 1;
  Eigen::Vector3d d(x, y, 1 - std::abs(x) - std::abs(y));
  if (d.z() < 0) {
    d.x() = (1 - std::abs(y)) * (x >= 0 ? 1 : -1);
    d.y() = (1 - std::abs(x)) * (y >= 0 ? 1 : -1);
  }
  return d.normalized();
}

// One ring of half vectors about the normal: one or two rows of the BRDF table.
struct Ring {
  int first_row = 0, rows = 1;
  int azimuths = 0;
  float sine = 0, cosine = 0;  ///< of its θh
  float solid_angle = 0;       ///< [sr] of one of its azimuth steps
  float start = 0;             ///< [rad]
};

// Solid angle [sr] between the cones θ = a and θ = b. cos a − cos b as a product: exact for the
// first row, a hundredth of a degree wide.
double band(double a, double b) {
  return 4 * std::numbers::pi * std::sin((a + b) / 2) * std::sin((b - a) / 2);
}

// θh at a row's edge (i whole) or centre (i + ½).
double theta_h_of(const BivariateGrid& grid, double i) {
  return std::numbers::pi / 2 * (i / grid.n_h) * (i / grid.n_h);
}

std::vector<Ring> rings_of(const BivariateGrid& grid) {
  std::vector<Ring> rings;
  for (int row = 0; row < grid.n_h;) {
    Ring ring;
    ring.first_row = row;
    ring.rows = row < rows_alone ? 1 : std::min(2, grid.n_h - row);
    ring.azimuths = std::min(8 + row, most_azimuths);
    const double theta = theta_h_of(grid, row + 0.5 * ring.rows);
    ring.sine = static_cast<float>(std::sin(theta));
    ring.cosine = static_cast<float>(std::cos(theta));
    ring.solid_angle = static_cast<float>(
        band(theta_h_of(grid, row), theta_h_of(grid, row + ring.rows)) / ring.azimuths);
    ring.start = static_cast<float>(
        std::fmod(golden_angle * static_cast<double>(rings.size()), 2 * std::numbers::pi));
    rings.push_back(ring);
    row += ring.rows;
  }
  return rings;
}

// f by ring and by sin(θd/2) in equal steps, channels together, holes filled: what the inner loop
// reads without an arc cosine.
std::vector<Eigen::Array3f> by_ring(const BrdfTable& table, const std::vector<Ring>& rings) {
  const BrdfLookup lookup(table);
  std::vector<Eigen::Array3f> f(rings.size() * columns, Eigen::Array3f::Zero());
  for (std::size_t r = 0; r < rings.size(); ++r) {
    for (int column = 0; column < columns; ++column) {
      const double theta_d =
          2 * std::asin(std::sqrt(0.5) * column / static_cast<double>(columns - 1));
      Eigen::Array3d sum = Eigen::Array3d::Zero();
      double weights = 0;
      for (int row = rings[r].first_row; row < rings[r].first_row + rings[r].rows; ++row) {
        const double weight = band(theta_h_of(table.grid, row), theta_h_of(table.grid, row + 1));
        const double theta_h = theta_h_of(table.grid, row + 0.5);
        for (int c = 0; c < 3; ++c) {
          sum[c] += weight * lookup(theta_h, theta_d, std::min(c, lookup.channels() - 1));
        }
        weights += weight;
      }
      f[r * columns + static_cast<std::size_t>(column)] = (sum / weights).cast<float>();
    }
  }
  return f;
}

// The environment averaged over a small cone about each direction: what rings further apart than
// its edges are wide must look up, or the gaps between them show as moiré.
Environment blurred(const Environment& sharp, double radius) {
  constexpr int samples = 64;
  return Environment(
      [&](const Eigen::Vector3d& axis) -> Eigen::Array3f {
        const Eigen::Vector3d t =
            (std::abs(axis.x()) < 0.9 ? Eigen::Vector3d::UnitX() : Eigen::Vector3d::UnitY())
                .cross(axis)
                .normalized();
        const Eigen::Vector3d b = axis.cross(t);
        Eigen::Array3f sum = Eigen::Array3f::Zero();
        for (int k = 0; k < samples; ++k) {
          const double r = std::tan(radius) * std::sqrt((k + 0.5) / samples);
          const double a = golden_angle * k;
          const Eigen::Vector3d d = axis + r * (std::cos(a) * t + std::sin(a) * b);
          sum += sharp(d.normalized().cast<float>());
        }
        return sum / samples;
      },
      96);
}

struct Scene {
  const Environment* sharp = nullptr;    ///< for the rings near the normal
  const Environment* blurred = nullptr;  ///< for the others
  std::vector<Ring> rings;
  std::vector<std::vector<Eigen::Array3f>> f;  ///< per material, by ring
};

// Radiance towards +z of every material at the sphere's point with this normal.
std::vector<Eigen::Array3f> shade(const Scene& scene, const Eigen::Vector3f& n) {
  std::vector<Eigen::Array3f> sum(scene.f.size(), Eigen::Array3f::Zero());
  const Eigen::Vector3f t =
      (std::abs(n.x()) < 0.9F ? Eigen::Vector3f::UnitX() : Eigen::Vector3f::UnitY())
          .cross(n)
          .normalized();
  const Eigen::Vector3f b = n.cross(t);
  for (std::size_t r = 0; r < scene.rings.size(); ++r) {
    const Ring& ring = scene.rings[r];
    const Environment& environment = ring.rows > 1 ? *scene.blurred : *scene.sharp;
    const auto step = static_cast<float>(2 * std::numbers::pi / ring.azimuths);
    const float turn_cos = std::cos(step), turn_sin = std::sin(step);
    float c = std::cos(ring.start), s = std::sin(ring.start);
    for (int k = 0; k < ring.azimuths; ++k) {
      const Eigen::Vector3f h = ring.sine * (c * t + s * b) + ring.cosine * n;
      const float turned = c * turn_cos - s * turn_sin;
      s = s * turn_cos + c * turn_sin;
      c = turned;
      const float v_h = std::min(h.z(), 1.0F);  // the view is +z
      if (v_h <= 0) continue;
      const Eigen::Vector3f wi = 2 * v_h * h - Eigen::Vector3f::UnitZ();
      const float cos_i = wi.dot(n);
      if (cos_i <= 0) continue;
      const Eigen::Array3f light = environment(wi) * (cos_i * 4 * v_h * ring.solid_angle);
      // sin(θd/2) = √((1 − v·h)/2), 0 … √½.
      const float x = std::sqrt(1 - v_h) * (columns - 1.001F);
      const auto column = static_cast<std::size_t>(x);
      const float w = x - static_cast<float>(column);
      const std::size_t i = r * columns + column;
      for (std::size_t m = 0; m < sum.size(); ++m) {
        sum[m] += light * ((1 - w) * scene.f[m][i] + w * scene.f[m][i + 1]);
      }
    }
  }
  return sum;
}

// Soft-edged disc of light: 1 within `radius` of its axis, 0 beyond radius + edge [rad].
double patch(const Eigen::Vector3d& d, const Eigen::Vector3d& axis, double radius, double edge) {
  const double angle = std::acos(std::clamp(d.dot(axis.normalized()), -1.0, 1.0));
  const double t = std::clamp((radius + edge - angle) / edge, 0.0, 1.0);
  return t * t * (3 - 2 * t);
}

// Soft-edged rectangle about an axis, half-widths across and up [rad].
double window(const Eigen::Vector3d& d, const Eigen::Vector3d& axis, double across, double up,
              double edge) {
  const Eigen::Vector3d z = axis.normalized();
  const Eigen::Vector3d x = Eigen::Vector3d::UnitY().cross(z).normalized();
  const Eigen::Vector3d y = z.cross(x);
  if (d.dot(z) <= 0) return 0;
  const auto side = [edge](double angle, double half) {
    const double t = std::clamp((half + edge - std::abs(angle)) / edge, 0.0, 1.0);
    return t * t * (3 - 2 * t);
  };
  return side(std::atan2(d.dot(x), d.dot(z)), across) * side(std::atan2(d.dot(y), d.dot(z)), up);
}

}  // namespace

Environment::Environment(const std::function<Eigen::Array3f(const Eigen::Vector3d&)>& radiance,
                         int size)
    : size_(size), texels_(static_cast<std::size_t>(size) * static_cast<std::size_t>(size)) {
  CHECK(size >= 2);
  for (int y = 0; y < size; ++y) {
    for (int x = 0; x < size; ++x) {
      texels_[static_cast<std::size_t>(y) * static_cast<std::size_t>(size) +
              static_cast<std::size_t>(x)] =
          radiance(direction_at((x + 0.5) / size, (y + 0.5) / size));
    }
  }
}

Eigen::Array3f Environment::operator()(const Eigen::Vector3f& direction) const {
  const Eigen::Array2f at = (octahedral(direction) * static_cast<float>(size_) - 0.5F)
                                .max(0.0F)
                                .min(static_cast<float>(size_) - 1.001F);
  const int x = static_cast<int>(at.x()), y = static_cast<int>(at.y());
  const float wx = at.x() - static_cast<float>(x), wy = at.y() - static_cast<float>(y);
  const auto stride = static_cast<std::size_t>(size_);
  const std::size_t i = static_cast<std::size_t>(y) * stride + static_cast<std::size_t>(x);
  return (1 - wy) * ((1 - wx) * texels_[i] + wx * texels_[i + 1]) +
         wy * ((1 - wx) * texels_[i + stride] + wx * texels_[i + stride + 1]);
}

Environment studio_environment() {
  return Environment(
      [](const Eigen::Vector3d& d) -> Eigen::Array3f {
        const double up = 0.5 * (d.y() + 1);
        Eigen::Array3d light =
            (1 - up) * Eigen::Array3d(0.10, 0.10, 0.10) + up * Eigen::Array3d(0.22, 0.24, 0.28);
        light += 9.0 * Eigen::Array3d(1.0, 0.96, 0.90) * patch(d, {-0.7, 0.75, 0.75}, 0.30, 0.08);
        light +=
            2.2 * Eigen::Array3d(0.72, 0.86, 1.0) * window(d, {0.95, 0.15, 0.35}, 0.20, 0.50, 0.05);
        light += 5.0 * Eigen::Array3d(1.0, 0.97, 0.92) *
                 window(d, {0.30, 0.85, -0.75}, 0.50, 0.12, 0.06);
        return light.cast<float>();
      },
      256);
}

std::vector<LinearImage> render_spheres(std::span<const BrdfTable* const> materials,
                                        const Environment& environment, int diameter, int threads) {
  CHECK(!materials.empty() && diameter > 0);
  const Environment soft = blurred(environment, 0.08);
  Scene scene{&environment, &soft, rings_of(materials[0]->grid), {}};
  for (const BrdfTable* material : materials) {
    CHECK(material->grid == materials[0]->grid);
    scene.f.push_back(by_ring(*material, scene.rings));
  }
  constexpr float nan = std::numeric_limits<float>::quiet_NaN();
  std::vector<LinearImage> images(
      materials.size(), {diameter, diameter,
                         std::vector<Eigen::Array3f>(static_cast<std::size_t>(diameter) *
                                                         static_cast<std::size_t>(diameter),
                                                     Eigen::Array3f::Constant(nan))});
  const auto render_rows = [&](int first, int stride) {
    for (int y = first; y < diameter; y += stride) {
      for (int x = 0; x < diameter; ++x) {
        const float u = 2 * (static_cast<float>(x) + 0.5F) / static_cast<float>(diameter) - 1;
        const float v = 1 - 2 * (static_cast<float>(y) + 0.5F) / static_cast<float>(diameter);
        const float r2 = u * u + v * v;
        if (r2 >= 1) continue;
        const std::vector<Eigen::Array3f> radiance = shade(scene, {u, v, std::sqrt(1 - r2)});
        const std::size_t pixel = static_cast<std::size_t>(y) * static_cast<std::size_t>(diameter) +
                                  static_cast<std::size_t>(x);
        for (std::size_t m = 0; m < images.size(); ++m) images[m].pixels[pixel] = radiance[m];
      }
    }
  };
  std::vector<std::jthread> workers;
  for (int t = 1; t < threads; ++t) workers.emplace_back(render_rows, t, threads);
  render_rows(0, std::max(1, threads));
  return images;
}

}  // namespace lightrig
