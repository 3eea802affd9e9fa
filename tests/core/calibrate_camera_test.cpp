#include "core/calibrate_camera.h"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <random>

namespace lightrig {
namespace {

using testing::HasSubstr;

constexpr double degree = std::numbers::pi / 180;

CameraModel true_camera(double size) {
  CameraModel camera;
  camera.width = static_cast<int>(640 * size);
  camera.height = static_cast<int>(480 * size);
  camera.fx = 812.5 * size;
  camera.fy = 809.25 * size;
  camera.cx = 322.75 * size;
  camera.cy = 236.5 * size;
  camera.distortion = {-0.21, 0.083, 0.0011, -0.0007, -0.012};
  return camera;
}

/// Views of a board of 9 × 6 squares of 30 mm, tilted to every side and brought to every corner.
std::vector<Eigen::Isometry3d> views(int count) {
  std::vector<Eigen::Isometry3d> poses;
  for (int i = 0; i < count; ++i) {
    const double around = 2 * std::numbers::pi * i / count;
    const double tilt = i % 4 == 3 ? 5 * degree : (20 + 6.0 * (i % 3)) * degree;
    Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();
    pose.translate(Eigen::Vector3d(0.08 * std::cos(2 * around), 0.06 * std::sin(2 * around),
                                   0.42 + 0.05 * (i % 3)));
    pose.rotate(Eigen::AngleAxisd(tilt, Eigen::Vector3d(std::cos(around), std::sin(around), 0)));
    pose.translate(Eigen::Vector3d(-0.135, -0.09, 0));
    poses.push_back(pose);
  }
  return poses;
}

CalibrationTarget board() {
  CalibrationTarget target;
  target.square = 0.03;
  target.marker = 0.022;
  return target;
}

TargetCorners corners_of(const CameraModel& camera, const Eigen::Isometry3d& pose,
                         std::mt19937& random, double noise) {
  std::normal_distribution<double> error(0, noise);
  CameraModel seen = camera;
  seen.camera_from_world = pose;
  TargetCorners corners;
  for (int r = 1; r < 6; ++r) {
    for (int c = 1; c < 9; ++c) {
      const Eigen::Vector3d p(0.03 * c, 0.03 * r, 0);
      const Eigen::Vector2d at = project(seen, p);
      if (at.x() < 0 || at.y() < 0 || at.x() > camera.width - 1 || at.y() > camera.height - 1)
        continue;
      corners.point.push_back(p);
      corners.pixel.push_back(at + Eigen::Vector2d(error(random), error(random)));
    }
  }
  return corners;
}

TEST(CalibrateCamera, FindsTheTruthWithinThreeStandardErrorsIn99Of100Runs) {
  const CameraModel truth = true_camera(1);
  const std::array<double, 9> expected{truth.fx,
                                       truth.fy,
                                       truth.cx,
                                       truth.cy,
                                       truth.distortion[0],
                                       truth.distortion[1],
                                       truth.distortion[2],
                                       truth.distortion[3],
                                       truth.distortion[4]};
  std::array<int, 9> outside{};
  double mean_square = 0;
  for (unsigned seed = 1; seed <= 100; ++seed) {
    std::mt19937 random(seed);
    std::vector<TargetCorners> found;
    for (const Eigen::Isometry3d& pose : views(12))
      found.push_back(corners_of(truth, pose, random, 0.05));
    const auto calibration = calibrate_camera(found, truth.width, truth.height);
    ASSERT_TRUE(calibration) << calibration.error().message;
    EXPECT_LT(calibration->rms, 0.1);
    EXPECT_NEAR(calibration->noise, 0.05, 0.005);
    const CameraModel& m = calibration->model;
    const std::array<double, 9> got{m.fx,
                                    m.fy,
                                    m.cx,
                                    m.cy,
                                    m.distortion[0],
                                    m.distortion[1],
                                    m.distortion[2],
                                    m.distortion[3],
                                    m.distortion[4]};
    for (std::size_t i = 0; i < 9; ++i) {
      const double z = (got[i] - expected[i]) / calibration->sigma[i];
      outside[i] += std::abs(z) > 3;
      mean_square += z * z / 900;
    }
  }
  for (std::size_t i = 0; i < 9; ++i) EXPECT_LE(outside[i], 1) << "parameter " << i;
  EXPECT_NEAR(mean_square, 1, 0.25);  // the errors stated are neither too large nor too small
}

/// Directions of sight of a camera, 4 × 4 to a pixel: found once, whatever the pose.
struct Sights {
  static constexpr int strata = 4;
  explicit Sights(const CameraModel& camera) : width(camera.width), height(camera.height) {
    for (int row = 0; row < height; ++row)
      for (int column = 0; column < width; ++column)
        for (int s = 0; s < strata * strata; ++s)
          directions.push_back(ray_through(camera, column + (s % strata + 0.5) / strata - 0.5,
                                           row + (s / strata + 0.5) / strata - 0.5)
                                   .direction);
  }
  int width, height;
  std::vector<Eigen::Vector3d> directions;
};

GreyImage rendered(const Sights& sights, const Eigen::Isometry3d& pose, const GreyImage& texture,
                   double pixels_per_m, double margin) {
  const Eigen::Isometry3d target_from_camera = pose.inverse();
  const Eigen::Vector3d eye = target_from_camera.translation();
  constexpr int samples = Sights::strata * Sights::strata;
  GreyImage image{sights.width, sights.height, {}};
  for (std::size_t first = 0; first < sights.directions.size(); first += samples) {
    double sum = 0;
    for (std::size_t s = 0; s < samples; ++s) {
      const Eigen::Vector3d d = target_from_camera.linear() * sights.directions[first + s];
      const Eigen::Vector3d p = eye - eye.z() / d.z() * d;
      const int x = static_cast<int>(std::floor(p.x() * pixels_per_m + margin));
      const int y = static_cast<int>(std::floor(p.y() * pixels_per_m + margin));
      const bool on = x >= 0 && y >= 0 && x < texture.width && y < texture.height;
      sum += on ? 20 + 0.8 * texture.pixels[static_cast<std::size_t>(y * texture.width + x)] : 120;
    }
    image.pixels.push_back(static_cast<std::uint8_t>(std::lround(sum / samples)));
  }
  return image;
}

TEST(CalibrateCamera, OfRenderedTargetsReprojectsBelowATenthOfAPixel) {
  const CameraModel truth = true_camera(0.75);
  const Sights sights(truth);
  for (const auto kind :
       {CalibrationTarget::Kind::charuco, CalibrationTarget::Kind::checkerboard}) {
    CalibrationTarget target = board();
    target.kind = kind;
    constexpr int pixels_per_square = 240;
    const GreyImage texture = target_image(target, pixels_per_square).value();
    std::vector<TargetCorners> found;
    for (const Eigen::Isometry3d& pose : views(10)) {
      auto corners = find_corners(
          rendered(sights, pose, texture, pixels_per_square / target.square, pixels_per_square / 2),
          target);
      if (corners) found.push_back(*corners);
    }
    ASSERT_GE(found.size(), 6U);
    const auto calibration = calibrate_camera(found, truth.width, truth.height);
    ASSERT_TRUE(calibration) << calibration.error().message;
    EXPECT_LT(calibration->rms, 0.1);
    fmt::print("{}: {} views, rms {:.4f} px\n",
               kind == CalibrationTarget::Kind::charuco ? "charuco" : "checkerboard", found.size(),
               calibration->rms);
    EXPECT_NEAR(calibration->model.fx / truth.fx, 1, 0.005);
    EXPECT_NEAR(calibration->model.cx, truth.cx, 1.5);
    EXPECT_NEAR(calibration->model.distortion[0], truth.distortion[0], 0.03);
  }
}

TEST(CalibrateCamera, RefusesWhatCannotDetermineTheLensAndSaysWhy) {
  const CameraModel truth = true_camera(1);
  std::mt19937 random(1);
  std::vector<TargetCorners> found;
  for (const Eigen::Isometry3d& pose : views(12))
    found.push_back(corners_of(truth, pose, random, 0.05));

  const auto few = calibrate_camera(std::span(found).first(3), 640, 480);
  ASSERT_FALSE(few);
  EXPECT_THAT(few.error().message, HasSubstr("found in 3 images"));

  std::vector<TargetCorners> alike;
  for (int i = 0; i < 6; ++i) {
    Eigen::Isometry3d flat = Eigen::Isometry3d::Identity();
    flat.translate(Eigen::Vector3d(-0.135 + 0.02 * i, -0.09 + 0.01 * i, 0.5));
    flat.rotate(Eigen::AngleAxisd(0.02 * i, Eigen::Vector3d::UnitX()));
    alike.push_back(corners_of(truth, flat, random, 0.05));
  }
  const auto flat = calibrate_camera(alike, 640, 480);
  ASSERT_FALSE(flat);
  EXPECT_THAT(flat.error().message, HasSubstr("tilt"));

  std::vector<TargetCorners> bent = found;
  for (TargetCorners& view : bent)
    for (std::size_t i = 0; i < view.pixel.size(); ++i)
      view.pixel[i].x() += 4 * std::sin(60 * view.point[i].x());
  const auto curved = calibrate_camera(bent, 640, 480);
  ASSERT_FALSE(curved);
  EXPECT_THAT(curved.error().message, HasSubstr("worst in image"));
}

TEST(CalibrateCamera, APictureWithoutTheTargetIsNotFoundAndATargetThatCannotBeIsRefused) {
  const GreyImage grey{320, 240, std::vector<std::uint8_t>(320 * 240, 128)};
  const auto nothing = find_corners(grey, board());
  ASSERT_FALSE(nothing);
  EXPECT_EQ(nothing.error().code, ErrorCode::not_found);
  CalibrationTarget wrong = board();
  wrong.marker = 0.04;
  const auto impossible = find_corners(grey, wrong);
  ASSERT_FALSE(impossible);
  EXPECT_EQ(impossible.error().code, ErrorCode::invalid_input);
  EXPECT_FALSE(target_image(wrong, 50));
}

}  // namespace
}  // namespace lightrig
