#pragma once

#include <Eigen/Core>
#include <functional>
#include <span>
#include <vector>

#include "core/brdf_table.h"
#include "daemon/session/picture.h"

namespace lightrig {

/// Distant light from all directions, in an octahedral map (equal steps of a folded octahedron, no
/// trigonometry to read it). +z faces the viewer, +y up.
class Environment {
 public:
  /// Samples radiance(direction) [any linear unit] on a size × size map.
  Environment(const std::function<Eigen::Array3f(const Eigen::Vector3d&)>& radiance, int size);

  /// Bilinear.
  Eigen::Array3f operator()(const Eigen::Vector3f& direction) const;

 private:
  int size_;
  std::vector<Eigen::Array3f> texels_;
};

/// The default surroundings of previews: a dim studio with a warm key soft-box, a cool window, and
/// a strip light from behind.
Environment studio_environment();

/// A sphere of each material under the same light, seen from far away on +z; radiance in the
/// environment's unit, NaN outside the disc. The integral runs over half vectors, so that a mirror
/// and a chalk are equally smooth: L = Σ f · L(wi) · cos θi · 4 (v·h) Δω_h. The result does not
/// depend on `threads`.
std::vector<LinearImage> render_spheres(std::span<const BrdfTable* const> materials,
                                        const Environment& environment, int diameter, int threads);

}  // namespace lightrig
