#pragma once

#include <Eigen/Core>
#include <array>
#include <vector>

namespace lightrig {

/// Bézier control points of a bicubic patch, row after row: P(u, v) = Σᵢⱼ Bᵢ(u) Bⱼ(v) p[4·i + j].
using BicubicPatch = std::array<Eigen::Vector3d, 16>;

/// The 32 patches of Newell's teapot (28 of 1975 and the bottom that was added to them), z up, in
/// the units of the published data: 3.15 high, its bottom at z = 0 [Newell 1975; Crow 1987].
std::vector<BicubicPatch> teapot_patches();

/// A point of a patch and the unit normal there.
struct PatchPoint {
  Eigen::Vector3d position;
  Eigen::Vector3d normal;  ///< along ∂P/∂v × ∂P/∂u, or its limit where an edge of the patch has
                           ///< shrunk to a point
};
PatchPoint evaluate(const BicubicPatch& patch, double u, double v);

}  // namespace lightrig
