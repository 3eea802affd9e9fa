#include "core/camera_model.h"

#include <gtest/gtest.h>

#include <cmath>
#include <opencv2/calib3d.hpp>
#include <random>
#include <vector>

namespace lightrig {
namespace {

CameraModel lab_camera() {
  CameraModel camera;
  camera.width = 640;
  camera.height = 480;
  camera.fx = 812.5;
  camera.fy = 809.25;
  camera.cx = 322.75;
  camera.cy = 236.5;
  camera.distortion = {-0.21, 0.083, 0.0011, -0.0007, -0.012};
  camera.camera_from_world =
      look_at({0.7, -0.4, 0.5}, {0.01, 0.02, 0.03}, Eigen::Vector3d::UnitZ());
  return camera;
}

Eigen::Vector2d opencv_project(const CameraModel& camera, const Eigen::Vector3d& p_in_world) {
  const Eigen::Vector3d p = camera.camera_from_world * p_in_world;
  const std::vector<cv::Point3d> points{{p.x(), p.y(), p.z()}};
  const cv::Matx33d k(camera.fx, 0, camera.cx, 0, camera.fy, camera.cy, 0, 0, 1);
  std::vector<cv::Point2d> pixels;
  cv::projectPoints(points, cv::Vec3d(0, 0, 0), cv::Vec3d(0, 0, 0), k,
                    std::vector<double>(camera.distortion.begin(), camera.distortion.end()),
                    pixels);
  return {pixels[0].x, pixels[0].y};
}

TEST(CameraModel, ProjectsAsOpenCvDoesWithDistortion) {
  const CameraModel camera = lab_camera();
  std::mt19937 random(1);
  std::uniform_real_distribution<double> offset(-0.2, 0.2);
  for (int i = 0; i < 1000; ++i) {
    const Eigen::Vector3d p(offset(random), offset(random), offset(random));
    EXPECT_LT((project(camera, p) - opencv_project(camera, p)).norm(), 1e-9);
  }
}

TEST(CameraModel, UndistortsAsOpenCvDoes) {
  const CameraModel camera = lab_camera();
  const cv::Matx33d k(camera.fx, 0, camera.cx, 0, camera.fy, camera.cy, 0, 0, 1);
  const std::vector<double> d(camera.distortion.begin(), camera.distortion.end());
  for (int v = 0; v < camera.height; v += 37) {
    for (int u = 0; u < camera.width; u += 41) {
      const std::vector<cv::Point2d> pixel{{static_cast<double>(u), static_cast<double>(v)}};
      std::vector<cv::Point2d> straight;
      cv::undistortPoints(
          pixel, straight, k, d, cv::noArray(), cv::noArray(),
          cv::TermCriteria(cv::TermCriteria::COUNT + cv::TermCriteria::EPS, 200, 1e-14));
      const Ray ray = ray_through(camera, u, v);
      const Eigen::Vector3d in_camera = camera.camera_from_world.linear() * ray.direction;
      EXPECT_NEAR(in_camera.x() / in_camera.z(), straight[0].x, 1e-9);
      EXPECT_NEAR(in_camera.y() / in_camera.z(), straight[0].y, 1e-9);
    }
  }
}

TEST(CameraModel, RayThroughAPixelProjectsBackToIt) {
  CameraModel camera = lab_camera();
  for (const auto projection :
       {CameraModel::Projection::perspective, CameraModel::Projection::orthographic}) {
    camera.projection = projection;
    std::mt19937 random(2);
    std::uniform_real_distribution<double> u(-0.5, 639.5), v(-0.5, 479.5), depth(0.05, 20);
    for (int i = 0; i < 1000; ++i) {
      const Eigen::Vector2d pixel(u(random), v(random));
      const Ray ray = ray_through(camera, pixel.x(), pixel.y());
      EXPECT_NEAR(ray.direction.norm(), 1, 1e-14);
      const Eigen::Vector3d p = ray.origin + depth(random) * ray.direction;
      EXPECT_LT((project(camera, p) - pixel).norm(), 1e-8);
      EXPECT_LT((view_direction(camera, p) + ray.direction).norm(), 1e-9);
    }
  }
}

TEST(CameraModel, AStrongWideLensStillInverts) {
  CameraModel camera = lab_camera();
  camera.fx = camera.fy = 300;  // 94° across
  // Monotone in r up to the corners and beyond (1 − 0.84 r² + 0.55 r⁴ > 0): invertible there.
  camera.distortion = {-0.28, 0.11, 0, 0, 0};
  for (int v = 0; v < 480; v += 53) {
    for (int u = 0; u < 640; u += 53) {
      const Ray ray = ray_through(camera, u, v);
      EXPECT_LT((project(camera, ray.origin + ray.direction) - Eigen::Vector2d(u, v)).norm(), 1e-8)
          << "at pixel " << u << ", " << v;
    }
  }
}

TEST(CameraModel, PointsBehindAPerspectiveCameraHaveNoPixel) {
  const CameraModel camera = lab_camera();
  const Ray ray = ray_through(camera, 320, 240);
  EXPECT_TRUE(project(camera, ray.origin - ray.direction).array().isNaN().all());
  EXPECT_TRUE(project(camera, ray.origin).array().isNaN().all());
}

TEST(CameraModel, LookAtPutsTheTargetAheadAndUpUpwards) {
  CameraModel camera;
  camera.width = camera.height = 101;
  camera.fx = camera.fy = 100;
  camera.cx = camera.cy = 50;
  // Worked by hand: from (0, -2, 0) along +y, x is right in the image and z is up.
  camera.camera_from_world = look_at({0, -2, 0}, {0, 0, 0}, Eigen::Vector3d::UnitZ());
  EXPECT_LT((project(camera, {0, 0, 0}) - Eigen::Vector2d(50, 50)).norm(), 1e-12);
  EXPECT_LT((project(camera, {0.2, 0, 0}) - Eigen::Vector2d(60, 50)).norm(), 1e-12);
  EXPECT_LT((project(camera, {0, 0, 0.2}) - Eigen::Vector2d(50, 40)).norm(), 1e-12);
  EXPECT_NEAR(camera.camera_from_world.linear().determinant(), 1, 1e-12);
}

TEST(CameraModel, LookingStraightAlongUpIsStillARotation) {
  const Eigen::Isometry3d down = look_at({0, 0, 1}, {0, 0, 0}, Eigen::Vector3d::UnitZ());
  EXPECT_NEAR(down.linear().determinant(), 1, 1e-12);
  EXPECT_LT((down.linear() * down.linear().transpose() - Eigen::Matrix3d::Identity()).norm(),
            1e-12);
  EXPECT_LT((down * Eigen::Vector3d::Zero() - Eigen::Vector3d(0, 0, 1)).norm(), 1e-12);
}

}  // namespace
}  // namespace lightrig
