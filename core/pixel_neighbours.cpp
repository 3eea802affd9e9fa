#include "core/pixel_neighbours.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>

#include "core/check.h"

namespace lightrig {
namespace {

/// [rad/px] A normal that turns by more than a cell of θd is wide (1°, as θh in the mean) on either
/// side of the pixel's centre blurs what the grid tells apart …
constexpr double least_turn_limit = 0.03;
/// [rad] … and where the turn itself changes by a third of that from one side of the pixel to the
/// other, central differences do not describe it: a crease, a rim, a facet's edge.
constexpr double least_bend_limit = 0.01;
/// A coarse picture has nothing better than its typical pixel: the limits are at least this many
/// medians.
constexpr double median_turns = 2, median_bends = 4;
/// Sine of the angle from which on a neighbour stands off the tangent plane: a step in depth.
constexpr double most_step = 0.5;

double median_of(std::vector<double> values) {
  if (values.empty()) return 0;
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

}  // namespace

PixelNeighbours::PixelNeighbours(const SurfacePoints& points, int width, int height)
    : points_(points), width_(width), height_(height), spacing_(std::max(width, height)) {
  CHECK(points.from_pixels);
  index_.assign(static_cast<std::size_t>(width) * static_cast<std::size_t>(height), -1);
  int previous_row = -1, previous_column = 0;
  for (Eigen::Index i = 0; i < points.size(); ++i) {
    const int source = points.source[static_cast<std::size_t>(i)];
    index_[static_cast<std::size_t>(source)] = static_cast<std::int32_t>(i);
    const int row = source / width, column = source % width;
    // The least step along a row is the stride the points were taken with.
    if (row == previous_row) spacing_ = std::min(spacing_, std::abs(column - previous_column));
    previous_row = row;
    previous_column = column;
  }
  spacing_ = std::max(spacing_, 1);
  find_whole();
}

void PixelNeighbours::find_whole() {
  const auto n = static_cast<std::size_t>(points_.size());
  whole_.resize(n);
  std::vector<double> turn(n, 0.0), bend(n, 0.0), turns, bends;
  for (std::size_t i = 0; i < n; ++i) {
    const auto point = static_cast<Eigen::Index>(i);
    whole_[i] = in_one_piece(point) ? 1 : 0;
    if (whole_[i] == 0) continue;
    const Slopes slope = slopes(point);
    turn[i] = std::max(slope.normal_u.norm(), slope.normal_v.norm());
    bend[i] = std::max(bend_along(point, 0, 1), bend_along(point, 1, 0));
    turns.push_back(turn[i]);
    bends.push_back(bend[i]);
  }
  const double most_turn = std::max(least_turn_limit, median_turns * median_of(std::move(turns)));
  const double most_bend = std::max(least_bend_limit, median_bends * median_of(std::move(bends)));
  for (std::size_t i = 0; i < n; ++i) {
    if (turn[i] > most_turn || bend[i] > most_bend) whole_[i] = 0;
  }
}

std::int32_t PixelNeighbours::at(Eigen::Index i, int rows, int columns) const {
  const int source = points_.source[static_cast<std::size_t>(i)];
  const int row = source / width_ + rows * spacing_, column = source % width_ + columns * spacing_;
  if (row < 0 || column < 0 || row >= height_ || column >= width_) return -1;
  return index_[static_cast<std::size_t>(row) * static_cast<std::size_t>(width_) +
                static_cast<std::size_t>(column)];
}

bool PixelNeighbours::in_one_piece(Eigen::Index i) const {
  const Eigen::Vector3d position = points_.position.col(i), normal = points_.normal.col(i);
  for (int rows = -1; rows <= 1; ++rows) {
    for (int columns = -1; columns <= 1; ++columns) {
      if (rows == 0 && columns == 0) continue;
      const std::int32_t j = at(i, rows, columns);
      if (j < 0) return false;
      const Eigen::Vector3d step = points_.position.col(j) - position;
      if (std::abs(normal.dot(step)) > most_step * step.norm()) return false;
    }
  }
  return true;
}

double PixelNeighbours::bend_along(Eigen::Index i, int rows, int columns) const {
  const Eigen::Vector3d ahead = points_.normal.col(at(i, rows, columns));
  const Eigen::Vector3d behind = points_.normal.col(at(i, -rows, -columns));
  return (ahead + behind - 2 * points_.normal.col(i)).norm() / (spacing_ * spacing_);
}

std::vector<std::uint8_t> PixelNeighbours::beside(const std::vector<std::uint8_t>& flagged) const {
  std::vector<std::uint8_t> out(flagged.size(), 0);
  for (std::size_t i = 0; i < flagged.size(); ++i) {
    if (flagged[i] == 0) continue;
    for (int rows = -1; rows <= 1; ++rows) {
      for (int columns = -1; columns <= 1; ++columns) {
        const std::int32_t j = at(static_cast<Eigen::Index>(i), rows, columns);
        if (j >= 0 && static_cast<std::size_t>(j) != i) out[static_cast<std::size_t>(j)] = 1;
      }
    }
  }
  return out;
}

PixelNeighbours::Slopes PixelNeighbours::slopes(Eigen::Index i) const {
  const std::int32_t left = at(i, 0, -1), right = at(i, 0, 1);
  const std::int32_t above = at(i, -1, 0), below = at(i, 1, 0);
  CHECK(left >= 0 && right >= 0 && above >= 0 && below >= 0);
  const double both = 2.0 * spacing_;
  return {(points_.position.col(right) - points_.position.col(left)) / both,
          (points_.position.col(below) - points_.position.col(above)) / both,
          (points_.normal.col(right) - points_.normal.col(left)) / both,
          (points_.normal.col(below) - points_.normal.col(above)) / both};
}

SurfacePoints PixelNeighbours::whole_points() const {
  std::vector<Eigen::Index> kept;
  for (std::size_t i = 0; i < whole_.size(); ++i) {
    if (whole_[i] != 0) kept.push_back(static_cast<Eigen::Index>(i));
  }
  SurfacePoints out;
  out.position = points_.position(Eigen::all, kept);
  out.normal = points_.normal(Eigen::all, kept);
  out.view = points_.view(Eigen::all, kept);
  out.source.reserve(kept.size());
  for (const Eigen::Index i : kept)
    out.source.push_back(points_.source[static_cast<std::size_t>(i)]);
  out.from_pixels = true;
  return out;
}

}  // namespace lightrig
