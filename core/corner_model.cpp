#include "core/corner_model.h"

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <numbers>
#include <optional>

namespace lightrig {
namespace {

constexpr double longest_move = 1.5;      // [px]
constexpr double widest_window = 9;       // [px] half
constexpr double reach = 0.42;            // of a square: half of the window
constexpr double marker_clearance = 1.2;  // [px] that a marker's blur reaches
constexpr double least_contrast = 4;      // [DN] half of what is between black and white
constexpr double worst_fit = 0.2;         // rms of what is left, of the contrast
constexpr int fewest_pixels = 24;

using Vector7 = Eigen::Matrix<double, 7, 1>;
using Matrix7 = Eigen::Matrix<double, 7, 7>;

/// How the board's squares lie about one of its corners: pixels per square along columns and rows,
/// from the corners around it.
std::optional<Eigen::Matrix2d> local_frame(const TargetCorners& corners, std::size_t at,
                                           double square) {
  Eigen::Matrix2d from = Eigen::Matrix2d::Zero(), to = Eigen::Matrix2d::Zero();
  for (std::size_t i = 0; i < corners.pixel.size(); ++i) {
    const Eigen::Vector2d d = (corners.point[i] - corners.point[at]).head<2>() / square;
    const double weight = std::exp(-d.squaredNorm() / 2);
    from += weight * d * d.transpose();
    to += weight * (corners.pixel[i] - corners.pixel[at]) * d.transpose();
  }
  if (!(from.determinant() > 1e-3 * std::pow(from.trace(), 2))) return std::nullopt;
  return Eigen::Matrix2d(to * from.inverse());
}

struct Pixel {
  double x, y;  // [px] from the corner as it was found
  double value;
};

std::vector<Pixel> window_about(const GreyImage& image, const Eigen::Vector2d& corner,
                                const Eigen::Matrix2d& frame, double gap) {
  const double square = std::min(frame.col(0).norm(), frame.col(1).norm());
  const double half = std::min(widest_window, reach * square);
  const Eigen::Matrix2d into = frame.inverse();
  const double clear = gap - marker_clearance / square;
  std::vector<Pixel> pixels;
  for (int y = static_cast<int>(std::ceil(corner.y() - half)); y <= corner.y() + half; ++y) {
    for (int x = static_cast<int>(std::ceil(corner.x() - half)); x <= corner.x() + half; ++x) {
      if (x < 0 || y < 0 || x >= image.width || y >= image.height) continue;
      const Eigen::Vector2d off = Eigen::Vector2d(x, y) - corner, in = into * off;
      if (off.squaredNorm() > half * half || in.cwiseAbs().minCoeff() > clear) continue;
      const auto at = static_cast<std::size_t>(y) * static_cast<std::size_t>(image.width) +
                      static_cast<std::size_t>(x);
      pixels.push_back({off.x(), off.y(), double{1} * image.pixels[at]});
    }
  }
  return pixels;
}

/// x, y [px], the directions [rad] of both edges' normals, s [px], m, c.
struct Fit {
  Matrix7 normal = Matrix7::Zero();
  Vector7 right = Vector7::Zero();
  double cost = 0;
};

Fit linearised(const std::vector<Pixel>& pixels, const Vector7& p) {
  Fit fit;
  const double c1 = std::cos(p[2]), s1 = std::sin(p[2]), c2 = std::cos(p[3]), s2 = std::sin(p[3]);
  for (const Pixel& pixel : pixels) {
    const double x = pixel.x - p[0], y = pixel.y - p[1];
    const double d1 = c1 * x + s1 * y, d2 = c2 * x + s2 * y, s = p[4];
    const double e1 = std::erf(d1 / s), e2 = std::erf(d2 / s);
    const double slope = 2 * std::numbers::inv_sqrtpi / s;
    const double g1 = slope * std::exp(-d1 * d1 / (s * s)) * e2 * p[6];
    const double g2 = slope * std::exp(-d2 * d2 / (s * s)) * e1 * p[6];
    Vector7 j;
    j << -g1 * c1 - g2 * c2, -g1 * s1 - g2 * s2, g1 * (c1 * y - s1 * x), g2 * (c2 * y - s2 * x),
        -(g1 * d1 + g2 * d2) / s, 1, e1 * e2;
    const double left = pixel.value - p[5] - p[6] * e1 * e2;
    fit.normal += j * j.transpose();
    fit.right += j * left;
    fit.cost += left * left;
  }
  return fit;
}

std::optional<Eigen::Vector2d> crossing(const std::vector<Pixel>& pixels,
                                        const Eigen::Matrix2d& frame) {
  if (static_cast<int>(pixels.size()) < fewest_pixels) return std::nullopt;
  // Across the rows' direction lies the normal of the edge along them, and the other way round.
  const double along_columns = std::atan2(frame(0, 0), -frame(1, 0));
  const double along_rows = std::atan2(frame(0, 1), -frame(1, 1));
  Vector7 p;
  p << 0, 0, along_columns, along_rows, 1, 0, 1;
  double low = 255, high = 0, sign = 0;
  for (const Pixel& pixel : pixels) {
    low = std::min(low, pixel.value);
    high = std::max(high, pixel.value);
  }
  p[5] = (low + high) / 2;
  for (const Pixel& pixel : pixels)
    sign += (pixel.value - p[5]) * std::erf(std::cos(p[2]) * pixel.x + std::sin(p[2]) * pixel.y) *
            std::erf(std::cos(p[3]) * pixel.x + std::sin(p[3]) * pixel.y);
  p[6] = std::copysign((high - low) / 2, sign);
  if (high - low < 2 * least_contrast) return std::nullopt;
  double damping = 1e-3;
  Fit here = linearised(pixels, p);
  for (int i = 0; i < 40 && damping < 1e6; ++i) {
    Matrix7 normal = here.normal;
    normal.diagonal() *= 1 + damping;
    const Vector7 move = normal.ldlt().solve(here.right);
    Vector7 there = p + move;
    there[4] = std::clamp(there[4], 0.2, 5.0);
    const Fit next = linearised(pixels, there);
    if (!(next.cost < here.cost)) {
      damping *= 10;
      continue;
    }
    p = there;
    here = next;
    damping *= 0.1;
    if (move.head<2>().norm() < 1e-4) break;
  }
  const double rms = std::sqrt(here.cost / static_cast<double>(pixels.size()));
  if (!p.allFinite() || p.head<2>().norm() > longest_move || rms > worst_fit * std::abs(p[6]))
    return std::nullopt;
  return Eigen::Vector2d(p[0], p[1]);
}

}  // namespace

TargetCorners refined(const GreyImage& image, const CalibrationTarget& target,
                      TargetCorners corners) {
  const bool charuco = target.kind == CalibrationTarget::Kind::charuco;
  const double gap = charuco ? (1 - target.marker / target.square) / 2 : 1e9;  // [squares]
  // Twice: the second time the windows lie where the corners are.
  for (int round = 0; round < 2; ++round) {
    const TargetCorners found = corners;
    for (std::size_t i = 0; i < found.pixel.size(); ++i) {
      const auto frame = local_frame(found, i, target.square);
      if (!frame) continue;
      const auto moved = crossing(window_about(image, found.pixel[i], *frame, gap), *frame);
      if (moved) corners.pixel[i] += *moved;
    }
  }
  return corners;
}

}  // namespace lightrig
