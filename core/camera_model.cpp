#include "core/camera_model.h"

#include <Eigen/LU>
#include <cmath>
#include <limits>

namespace lightrig {
namespace {

/// Distorted image coordinates (focal length 1) of undistorted ones, with the derivative that
/// Newton's method needs.
struct Distorted {
  Eigen::Vector2d p;
  Eigen::Matrix2d derivative;
};

// x' = x (1 + k1 r² + k2 r⁴ + k3 r⁶) + 2 p1 x y + p2 (r² + 2x²),
// y' = y (1 + k1 r² + k2 r⁴ + k3 r⁶) + p1 (r² + 2y²) + 2 p2 x y   [Brown 1966; OpenCV calib3d]
Distorted distort(const std::array<double, 5>& d, const Eigen::Vector2d& q) {
  const double k1 = d[0], k2 = d[1], p1 = d[2], p2 = d[3], k3 = d[4];
  const double x = q.x(), y = q.y();
  const double r2 = q.squaredNorm();
  const double radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3));
  const double slope = 2 * (k1 + r2 * (2 * k2 + r2 * 3 * k3));  // d(radial)/dr² · 2
  Distorted out;
  out.p << x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x),
      y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y;
  const double off_diagonal = x * y * slope + 2 * p1 * x + 2 * p2 * y;
  out.derivative << radial + x * x * slope + 2 * p1 * y + 6 * p2 * x, off_diagonal, off_diagonal,
      radial + y * y * slope + 6 * p1 * y + 2 * p2 * x;
  return out;
}

/// Inverse of distort by Newton's method with step halving, from the distorted point itself.
/// Quadratic where OpenCV's fixed-point iteration is linear, and it does not run away at the rim of
/// a wide lens.
Eigen::Vector2d undistort(const std::array<double, 5>& d, const Eigen::Vector2d& target) {
  if (d == std::array<double, 5>{}) return target;
  Eigen::Vector2d q = target;
  Distorted at_q = distort(d, q);
  Eigen::Vector2d residual = at_q.p - target;
  for (int round = 0; round < 50 && residual.norm() > 1e-15 * (1 + target.norm()); ++round) {
    const Eigen::Vector2d step = at_q.derivative.partialPivLu().solve(residual);
    if (!step.allFinite()) break;
    double scale = 1;
    bool improved = false;
    for (int halving = 0; halving < 30 && !improved; ++halving, scale /= 2) {
      const Eigen::Vector2d trial = q - scale * step;
      const Distorted at_trial = distort(d, trial);
      const Eigen::Vector2d trial_residual = at_trial.p - target;
      if (trial_residual.norm() < residual.norm()) {
        q = trial;
        at_q = at_trial;
        residual = trial_residual;
        improved = true;
      }
    }
    if (!improved) break;
  }
  return q;
}

}  // namespace

Ray ray_through(const CameraModel& camera, double u, double v) {
  const Eigen::Isometry3d world_from_camera = camera.camera_from_world.inverse();
  const Eigen::Vector2d image((u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy);
  if (distant(camera)) {
    const Eigen::Vector3d origin(image.x(), image.y(), 0);
    return {world_from_camera * origin, world_from_camera.linear() * Eigen::Vector3d::UnitZ()};
  }
  const Eigen::Vector2d straight = undistort(camera.distortion, image);
  const Eigen::Vector3d direction = Eigen::Vector3d(straight.x(), straight.y(), 1).normalized();
  return {world_from_camera.translation(), world_from_camera.linear() * direction};
}

Eigen::Vector2d project(const CameraModel& camera, const Eigen::Vector3d& p_in_world) {
  const Eigen::Vector3d p = camera.camera_from_world * p_in_world;
  if (distant(camera)) {
    return {camera.fx * p.x() + camera.cx, camera.fy * p.y() + camera.cy};
  }
  if (!(p.z() > 0)) {
    return Eigen::Vector2d::Constant(std::numeric_limits<double>::quiet_NaN());
  }
  const Eigen::Vector2d bent = distort(camera.distortion, p.head<2>() / p.z()).p;
  return {camera.fx * bent.x() + camera.cx, camera.fy * bent.y() + camera.cy};
}

Eigen::Vector3d view_direction(const CameraModel& camera, const Eigen::Vector3d& p_in_world) {
  const Eigen::Matrix3d world_from_camera = camera.camera_from_world.linear().transpose();
  if (distant(camera)) return -world_from_camera.col(2);
  const Eigen::Vector3d eye = -(world_from_camera * camera.camera_from_world.translation());
  return (eye - p_in_world).normalized();
}

Eigen::Isometry3d look_at(const Eigen::Vector3d& eye, const Eigen::Vector3d& target,
                          const Eigen::Vector3d& up) {
  const Eigen::Vector3d forward = (target - eye).normalized();
  Eigen::Vector3d right = forward.cross(up.normalized());
  if (right.norm() < 1e-9) {
    // Looking along `up`: any roll fits, take the one given by the axis least aligned with the
    // view.
    Eigen::Index least = 0;
    forward.cwiseAbs().minCoeff(&least);
    right = forward.cross(Eigen::Vector3d::Unit(least));
  }
  right.normalize();
  Eigen::Isometry3d camera_from_world = Eigen::Isometry3d::Identity();
  camera_from_world.linear().row(0) = right.transpose();
  camera_from_world.linear().row(1) = forward.cross(right).transpose();
  camera_from_world.linear().row(2) = forward.transpose();
  camera_from_world.translation() = -(camera_from_world.linear() * eye);
  return camera_from_world;
}

}  // namespace lightrig
