#include "core/cell_lookup.h"

#include <cmath>
#include <limits>

#include "core/check.h"
#include "core/half_diff.h"

namespace lightrig {

namespace {

/// The least double x ≥ 0 with index_of(x) ≥ i, for i = 1 … n − 1 and an index_of that never
/// decreases; found by bisection over the doubles themselves, whose bits are ordered as they are.
template <class IndexOf>
std::vector<double> boundaries(int n, const IndexOf& index_of) {
  std::vector<double> out;
  for (int i = 1; i < n; ++i) {
    std::int64_t low = 0;
    std::int64_t high = std::bit_cast<std::int64_t>(std::numeric_limits<double>::max());
    while (high - low > 1) {
      const std::int64_t middle = low + (high - low) / 2;
      (index_of(std::bit_cast<double>(middle)) >= i ? high : low) = middle;
    }
    out.push_back(std::bit_cast<double>(high));
  }
  return out;
}

std::vector<double> row_boundaries(const BivariateGrid& grid) {
  return boundaries(
      grid.n_h, [&](double chord2) { return row_of_theta_h(grid, theta_of_half_chord2(chord2)); });
}

std::vector<double> column_boundaries(const BivariateGrid& grid) {
  return boundaries(grid.n_d, [&](double tangent2) {
    return column_of_theta_d(grid, theta_of_difference_tangent2(tangent2));
  });
}

}  // namespace

BoundarySearch::BoundarySearch(const std::vector<double>& boundary) : bucket_(1) {
  if (boundary.empty()) return;
  const auto bits = [&](std::size_t i) { return std::bit_cast<std::int64_t>(boundary[i]); };
  // As coarse as one boundary per bucket allows.
  for (shift_ = 52; shift_ > 0; --shift_) {
    bool alone = true;
    for (std::size_t i = 1; i < boundary.size() && alone; ++i) {
      alone = (bits(i) >> shift_) > (bits(i - 1) >> shift_);
    }
    if (alone) break;
  }
  first_ = bits(0) >> shift_;
  const std::int64_t last = bits(boundary.size() - 1) >> shift_;
  CHECK(last - first_ < (std::int64_t{1} << 28));
  last_bucket_ = last - first_;
  bucket_.resize(static_cast<std::size_t>(last_bucket_ + 1));
  for (std::size_t i = 0; i < boundary.size(); ++i) {
    const auto bucket = static_cast<std::size_t>((bits(i) >> shift_) - first_);
    bucket_[bucket].split = boundary[i];
    for (std::size_t b = bucket + 1; b < bucket_.size(); ++b) ++bucket_[b].below;
  }
}

CellLookup::CellLookup(const BivariateGrid& grid)
    : grid_(grid),
      row_begin_(row_boundaries(grid)),
      column_begin_(column_boundaries(grid)),
      row_(row_begin_),
      column_(column_begin_) {
  for (std::vector<double>* begin : {&row_begin_, &column_begin_}) {
    begin->insert(begin->begin(), 0.0);
    begin->push_back(std::numeric_limits<double>::infinity());
  }
}

int CellLookup::operator()(const Eigen::Vector3d& n, const Eigen::Vector3d& wi,
                           const Eigen::Vector3d& wo) const {
  const Eigen::Vector3d sum = wi + wo;
  const Eigen::Vector3d h =
      sum / std::sqrt(sum.x() * sum.x() + sum.y() * sum.y() + sum.z() * sum.z());
  const double chord2 = half_chord2(n.x(), n.y(), n.z(), h.x(), h.y(), h.z());
  return grid_.cell(row(chord2), column(difference_tangent2(wi, wo)));
}

}  // namespace lightrig
