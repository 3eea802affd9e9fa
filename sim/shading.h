#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <stop_token>
#include <vector>

#include "core/brdf_table.h"
#include "core/camera_model.h"
#include "core/light.h"
#include "core/mesh.h"
#include "core/sensor.h"

// The laboratory's own light: written apart from the code that plans, extracts and fits, so that a
// mistake there cannot cancel against the same mistake here. Only the type HalfDiff is shared,
// because a Reflectance takes it.

namespace lightrig::sim {

/// Half/difference angles by spherical geometry about the sum and difference of the directions, not
/// by rotating frames. n, wi, wo unit, wi ≠ −wo.
HalfDiff angles_of(const Eigen::Vector3d& n, const Eigen::Vector3d& wi, const Eigen::Vector3d& wo);

/// f(n, wi, wo) · cos θi [1/sr]; zero when either direction is not above the surface.
Eigen::Array3d reflected(const Reflectance& reflectance, const Eigen::Vector3d& n,
                         const Eigen::Vector3d& wi, const Eigen::Vector3d& wo);

struct RenderOptions {
  /// Stratified jittered samples per sensor site are the square of this. Against the mean over the
  /// site's area, a glossy teapot (α = 0.05, 320 × 240) is off by 15 % rms with 1, 5 % with 2, 4 %
  /// with 3, mostly at silhouettes and highlights; shading costs 10, 34, 85 ms a light (640 × 480,
  /// one core). 2 is the default: what is gained beyond is small against what lens blur would add.
  int strata = 2;
  int threads = 0;         ///< 0: as many as the machine has
  std::uint64_t seed = 1;  ///< of the jitter
};

/// Radiance per sensor site: (height · width) of the site's own channel [W m⁻² sr⁻¹].
using SiteRadiance = std::vector<float>;

/// One scene under any lamp: what each site sees is found once, so that a light costs shading and
/// shadow rays alone. Immutable; safe to share between threads. The result does not depend on the
/// number of threads.
class Renderer {
 public:
  Renderer(Mesh mesh, CameraModel camera, ColorFilter filter, Reflectance reflectance,
           const RenderOptions& options);
  ~Renderer();
  Renderer(Renderer&&) noexcept;
  Renderer& operator=(Renderer&&) noexcept;

  /// Direct light of a lamp of this strength ([W/sr] near, [W/m²] distant, per channel) with hard
  /// shadows; no interreflection. Empty when stopped, within a few milliseconds.
  std::optional<SiteRadiance> render(const LightPosition& light, const Eigen::Array3d& strength,
                                     const std::stop_token& stop) const;

  /// Sites that see the object in at least one sample.
  std::int64_t sites_covered() const;

 private:
  struct Scene;
  std::unique_ptr<const Scene> scene_;
};

}  // namespace lightrig::sim
