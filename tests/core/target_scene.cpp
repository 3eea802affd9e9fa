#include "target_scene.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

namespace lightrig::test {
namespace {

constexpr double degree = std::numbers::pi / 180;

/// Uniform in [0, 1), 53 bits: quick, and the same everywhere.
double uniform(std::mt19937_64& random) { return static_cast<double>(random() >> 11U) * 0x1p-53; }

/// Quantiles of the standard normal distribution, drawn from: as good as the distribution for what
/// blurs and what is noise.
class Normal {
 public:
  Normal() {
    std::mt19937_64 random(1);
    for (std::size_t i = 0; i < values_.size(); ++i) {
      // Box & Muller, with one of the two numbers even over its range.
      const double radius = std::sqrt(
          -2 * std::log((static_cast<double>(i) + 0.5) / static_cast<double>(values_.size())));
      values_[i] = radius * std::cos(2 * std::numbers::pi * uniform(random));
    }
  }
  double operator()(std::uint64_t bits) const { return values_[bits % values_.size()]; }

 private:
  std::array<double, 1U << 14U> values_{};
};

/// Light that the camera sees in a direction: of the target, or of the wall behind.
class Seen {
 public:
  Seen(const Sights& sights, const Eigen::Isometry3d& camera_from_target, const GreyImage& texture,
       double per_m, double margin)
      : sights_(sights),
        texture_(texture),
        turn_(camera_from_target.linear().transpose()),
        eye_(camera_from_target.inverse().translation()),
        per_m_(per_m),
        margin_(margin) {}

  double at(double u, double v) const {
    const Eigen::Vector3d d = turn_ * sights_.through(u, v);
    const Eigen::Vector3d p = eye_ - eye_.z() / d.z() * d;
    const auto x = static_cast<int>(std::floor(p.x() * per_m_ + margin_));
    const auto y = static_cast<int>(std::floor(p.y() * per_m_ + margin_));
    if (x < 0 || y < 0 || x >= texture_.width || y >= texture_.height) return 120;
    const auto at = static_cast<std::size_t>(y) * static_cast<std::size_t>(texture_.width) +
                    static_cast<std::size_t>(x);
    return 20 + 0.8 * texture_.pixels[at];
  }
  /// Whether all is alike about a pixel, as far as blur reaches.
  bool even(int column, int row, double reach) const {
    const double here = at(column, row);
    for (int i = -2; i <= 2; ++i)
      for (int j = -2; j <= 2; ++j)
        if (at(column + i * reach / 2, row + j * reach / 2) != here) return false;
    return true;
  }

 private:
  const Sights& sights_;
  const GreyImage& texture_;
  const Eigen::Matrix3d turn_;
  const Eigen::Vector3d eye_;
  const double per_m_, margin_;
};

}  // namespace

Sights::Sights(const CameraModel& camera) : width(camera.width), height(camera.height) {
  CameraModel here = camera;
  here.camera_from_world = Eigen::Isometry3d::Identity();
  for (int row = 0; row <= height; ++row)
    for (int column = 0; column <= width; ++column) {
      const Eigen::Vector3d d = ray_through(here, column - 0.5, row - 0.5).direction;
      corners_.push_back(d / d.z());
    }
}

Eigen::Vector3d Sights::through(double u, double v) const {
  const double x = std::clamp(u + 0.5, 0.0, double{1} * width);
  const double y = std::clamp(v + 0.5, 0.0, double{1} * height);
  const int column = std::min(width - 1, static_cast<int>(x));
  const int row = std::min(height - 1, static_cast<int>(y));
  const auto at = static_cast<std::size_t>(row) * static_cast<std::size_t>(width + 1) +
                  static_cast<std::size_t>(column);
  const double right = x - column, down = y - row;
  const auto below = at + static_cast<std::size_t>(width + 1);
  return (1 - down) * ((1 - right) * corners_[at] + right * corners_[at + 1]) +
         down * ((1 - right) * corners_[below] + right * corners_[below + 1]);
}

GreyImage picture_of_target(const Sights& sights, const Eigen::Isometry3d& camera_from_target,
                            const GreyImage& texture, const CalibrationTarget& target,
                            int pixels_per_square, const TargetPicture& how,
                            std::mt19937_64& random) {
  static const Normal normal;
  const double margin = pixels_per_square / 2;  // NOLINT: target_image() rounds it down
  const Seen seen(sights, camera_from_target, texture, pixels_per_square / target.square, margin);
  GreyImage image{sights.width, sights.height, {}};
  for (int row = 0; row < image.height; ++row)
    for (int column = 0; column < image.width; ++column) {
      const bool even = seen.even(column, row, 0.5 + 4 * how.blur);
      const int strata = even ? 1 : how.samples;
      double sum = even ? seen.at(column, row) : 0;
      for (int s = 0; !even && s < strata * strata; ++s) {
        const std::uint64_t place = random(), spread = how.blur > 0 ? random() : 0;
        const double right = static_cast<double>(place >> 32U) * 0x1p-32;
        const double down = static_cast<double>(place & 0xFFFFFFFFU) * 0x1p-32;
        sum += seen.at(
            column - 0.5 + (s % strata + right) / strata + how.blur * normal(spread >> 32U),
            row - 0.5 + (s / strata + down) / strata + how.blur * normal(spread & 0xFFFFFFFFU));
      }
      const double value = sum / (strata * strata) + how.noise * normal(random() >> 32U);
      image.pixels.push_back(static_cast<std::uint8_t>(std::lround(std::clamp(value, 0.0, 255.0))));
    }
  return image;
}

TargetCorners true_corners(const CameraModel& camera, const Eigen::Isometry3d& camera_from_target,
                           const CalibrationTarget& target) {
  CameraModel seen = camera;
  seen.camera_from_world = camera_from_target;
  TargetCorners corners;
  for (int row = 1; row < target.rows; ++row)
    for (int column = 1; column < target.columns; ++column) {
      const Eigen::Vector3d p(target.square * column, target.square * row, 0);
      const Eigen::Vector2d at = project(seen, p);
      if (at.x() < 0 || at.y() < 0 || at.x() > camera.width - 1 || at.y() > camera.height - 1)
        continue;
      corners.point.push_back(p);
      corners.pixel.push_back(at);
    }
  return corners;
}

std::vector<Eigen::Isometry3d> drawn_views(const CameraModel& camera,
                                           const CalibrationTarget& target, int count, bool whole,
                                           std::mt19937_64& random) {
  const Eigen::Vector3d middle(target.square * target.columns / 2, target.square * target.rows / 2,
                               0);
  std::vector<Eigen::Isometry3d> views;
  for (int tries = 0; static_cast<int>(views.size()) < count && tries < 100000; ++tries) {
    const double around = 2 * std::numbers::pi * uniform(random);
    const double tilt = (5 + 30 * uniform(random)) * degree;
    const double roll = (20 * uniform(random) - 10) * degree;
    // So far that the target is 0.5 to 0.8 of the picture's width.
    const double share = 0.5 + 0.3 * uniform(random);
    const double depth = camera.fx * target.square * target.columns / (share * camera.width);
    Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();
    pose.translate(depth *
                   Eigen::Vector3d((0.6 * uniform(random) - 0.3) * camera.width / camera.fx,
                                   (0.6 * uniform(random) - 0.3) * camera.height / camera.fy, 1));
    pose.rotate(Eigen::AngleAxisd(tilt, Eigen::Vector3d(std::cos(around), std::sin(around), 0)));
    pose.rotate(Eigen::AngleAxisd(roll, Eigen::Vector3d::UnitZ()));
    pose.translate(-middle);
    CalibrationTarget rim = target;  // whose inner corners are the target's and its outline
    rim.columns += 2;
    rim.rows += 2;
    const auto in_picture = static_cast<int>(
        true_corners(camera, pose * Eigen::Translation3d(-target.square, -target.square, 0), rim)
            .pixel.size());
    if (in_picture < (whole ? rim.corners() : rim.corners() / 2)) continue;
    views.push_back(pose);
  }
  return views;
}

Deviations deviations(const CameraCalibration& calibration, const CameraModel& truth,
                      const std::vector<Eigen::Isometry3d>& camera_from_target) {
  const auto numbers = [](const CameraModel& c) {
    const auto& d = c.distortion;
    return std::array<double, 9>{c.fx, c.fy, c.cx, c.cy, d[0], d[1], d[2], d[3], d[4]};
  };
  const auto turn_of = [](const Eigen::Isometry3d& pose) {
    const Eigen::AngleAxisd turn(pose.linear());
    return Eigen::Vector3d(turn.angle() * turn.axis());
  };
  Deviations out;
  const auto found = numbers(calibration.model), expected = numbers(truth);
  for (std::size_t i = 0; i < 9; ++i) out.lens[i] = (found[i] - expected[i]) / calibration.sigma[i];
  for (std::size_t i = 0; i < camera_from_target.size(); ++i) {
    const ViewFit& view = calibration.views[i];
    const Eigen::Isometry3d &got = view.camera_from_target, &is = camera_from_target[i];
    Eigen::Matrix<double, 6, 1> off;
    off << turn_of(got) - turn_of(is), got.translation() - is.translation();
    std::array<double, 6>& z = out.poses.emplace_back();
    for (Eigen::Index k = 0; k < 6; ++k)
      z[static_cast<std::size_t>(k)] = off[k] / view.pose_sigma[k];
  }
  return out;
}

}  // namespace lightrig::test
