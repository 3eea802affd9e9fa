#pragma once

#include <Eigen/Core>

namespace lightrig {

/// Complex refractive index n + ik of a medium met from air, at one wavelength per channel: red 659
/// nm, green 549 nm, blue 451 nm, where Johnson & Christy measured. k = 0 for a dielectric.
struct RefractiveIndex {
  Eigen::Array3d n = Eigen::Array3d::Constant(1.5);
  Eigen::Array3d k = Eigen::Array3d::Zero();
};

/// Share of unpolarised light reflected by a plane surface, per channel, in [0, 1]; cos_d in [0, 1]
/// is the cosine of incidence. [Born & Wolf 1999, §1.5 and §14.2]
Eigen::Array3d fresnel(const RefractiveIndex& index, double cos_d);

}  // namespace lightrig
