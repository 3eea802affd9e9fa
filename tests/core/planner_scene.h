#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "core/brdf_basis.h"
#include "core/camera_model.h"
#include "core/candidate_bins.h"
#include "core/mesh.h"
#include "core/planner.h"

namespace lightrig::test {

/// The optional data folder ($LIGHTRIG_DATA, else ../shared/data beside the source); empty where it
/// is absent.
std::optional<std::string> data_folder();

/// A mesh of the data folder, scaled to a bounding sphere of radius 1 about the origin.
Mesh data_mesh(const std::string& folder, const std::string& name);

/// A unit sphere: an octahedron split `levels` times; vertices, normals and triangles.
Mesh sphere_mesh(int levels);

/// PCA of the folder's 100 materials, k components.
BrdfBasis data_basis(const std::string& folder, ChannelLayout layout, Eigen::Index k);

/// A basis of smooth random functions with coefficients whose spread falls off by `fall` per
/// component; orthonormal, seeded.
BrdfBasis random_basis(std::uint64_t seed, BivariateGrid grid, ChannelLayout layout, int channels,
                       Eigen::Index k, double fall);

/// Bins drawn at random: each candidate a few runs of rows in one or more columns; some empty, some
/// equal.
CandidateBins random_bins(std::uint64_t seed, BivariateGrid grid, int candidates, bool one_column);

/// Directions spread evenly over the sphere (a Fibonacci spiral) as lamps: distant, or on a radius.
std::vector<LightPosition> spread_lights(int count, bool distant, double radius);

/// A camera that looks at the origin from `distance` along −y, upright, a unit sphere filling most
/// of its image; orthographic where distant.
CameraModel facing_camera(bool distant, double distance, int width, int height);

/// One more light where the third of `whole` is lost and the others stand.
void lose_third_light(const Selection& whole, std::size_t candidates, SelectionOptions& options);

}  // namespace lightrig::test
