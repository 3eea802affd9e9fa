#include "core/half_diff.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <numbers>

namespace lightrig {

double theta_of_half_chord2(double chord2) {
  return 2.0 * std::asin(std::min(1.0, 0.5 * std::sqrt(chord2)));
}

double theta_of_difference_tangent2(double tangent2) { return std::atan(std::sqrt(tangent2)); }

HalfDiff half_diff(const Eigen::Vector3d& n, const Eigen::Vector3d& wi, const Eigen::Vector3d& wo) {
  const Eigen::Vector3d sum = wi + wo;
  const Eigen::Vector3d h =
      sum / std::sqrt(sum.x() * sum.x() + sum.y() * sum.y() + sum.z() * sum.z());
  HalfDiff angles;
  angles.theta_h = theta_of_half_chord2(half_chord2(n.x(), n.y(), n.z(), h.x(), h.y(), h.z()));
  angles.theta_d = theta_of_difference_tangent2(difference_tangent2(wi, wo));

  // The frame that Rusinkiewicz reaches by turning h to the pole: y' = n × h, x' = y' × h. The
  // difference n − h is exact where the two nearly agree, so n × h = (n − h) × h keeps its
  // direction there.
  const Eigen::Vector3d y = (n - h).cross(h);
  const Eigen::Vector3d x = y.cross(h);
  const Eigen::Vector3d d = wi - wo;  // 2 sin θd along the light's azimuth: h has no part in it
  const double sine = d.dot(y), cosine = d.dot(x);
  if (sine == 0.0 && cosine == 0.0) return angles;
  double phi = std::atan2(sine, cosine);
  if (phi < 0.0) phi += std::numbers::pi;
  angles.phi_d = std::min(phi, std::numbers::pi);
  return angles;
}

DirectionPair directions(const HalfDiff& angles) {
  const double sin_h = std::sin(angles.theta_h), cos_h = std::cos(angles.theta_h);
  const double sin_d = std::sin(angles.theta_d), cos_d = std::cos(angles.theta_d);
  const double x = sin_d * std::cos(angles.phi_d), y = sin_d * std::sin(angles.phi_d);
  // The light is (x, y, cos θd) about the half vector and the camera its mirror image (−x, −y,
  // cos θd); a turn by θh about the y axis brings the half vector from the pole to where it is.
  return {{cos_h * x + sin_h * cos_d, y, -sin_h * x + cos_h * cos_d},
          {-cos_h * x + sin_h * cos_d, -y, sin_h * x + cos_h * cos_d}};
}

}  // namespace lightrig
