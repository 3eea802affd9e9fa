#include "core/taken_rows.h"

#include <algorithm>
#include <cstddef>
#include <limits>
#include <numeric>
#include <utility>

#include "core/row_factor.h"

namespace lightrig {

namespace {

/// xᵀAx of an upper triangle (k × stride).
double quadratic_form(std::span<const double> A, std::span<const double> x, int k, int stride) {
  double sum = 0;
  for (int i = 0; i < k; ++i) {
    const double* row = A.data() + static_cast<std::ptrdiff_t>(i) * stride;
    double along = 0.5 * row[i] * x[static_cast<std::size_t>(i)];
    for (int j = i + 1; j < k; ++j) along += row[j] * x[static_cast<std::size_t>(j)];
    sum += 2 * along * x[static_cast<std::size_t>(i)];
  }
  return sum;
}

}  // namespace

TakenRows::TakenRows(const PackedRows& rows, int level) : rows_(rows), level_(level) {
  gram_.assign(static_cast<std::size_t>(rows.k) * static_cast<std::size_t>(rows.stride), 0.0);
  R_.k = rows.k;
  R_.stride = rows.stride;
  had_ = R_;
}

void TakenRows::stand_on(const Eigen::MatrixXd& had) {
  if (had.rows() == 0) return;
  had_.data.resize(static_cast<std::size_t>(had.rows()) * static_cast<std::size_t>(rows_.stride));
  std::fill(had_.data.begin(), had_.data.end(), 0.0);
  for (Eigen::Index r = 0; r < had.rows(); ++r) {
    for (int j = 0; j < rows_.k; ++j) {
      had_.data[static_cast<std::size_t>(r * rows_.stride + j)] = had(r, j);
    }
  }
  std::vector<std::int32_t> all(static_cast<std::size_t>(had.rows()));
  std::iota(all.begin(), all.end(), 0);
  add_gram(had_, all, gram_, level_);
  count_ += had.rows();
  had_behind_ = true;
}

void TakenRows::take(std::span<const std::int32_t> cells) {
  behind_.insert(behind_.end(), cells.begin(), cells.end());
  add_gram(rows_, cells, gram_, level_);
  count_ += static_cast<Eigen::Index>(cells.size()) * rows_.per_cell;
}

void TakenRows::take(std::span<const std::int32_t> cells, PackedRows R) {
  take(cells);
  R_ = std::move(R);
  behind_.clear();
  had_behind_ = false;
}

void TakenRows::clear() {
  std::fill(gram_.begin(), gram_.end(), 0.0);
  R_.data.clear();
  behind_.clear();
  had_behind_ = false;
  count_ = 0;
}

const PackedRows& TakenRows::factor() {
  if (had_behind_) {
    std::vector<std::int32_t> all(had_.data.size() / static_cast<std::size_t>(had_.stride));
    std::iota(all.begin(), all.end(), 0);
    extend_factor(R_, had_, all, next_, scratch_, level_);
    std::swap(R_, next_);
    had_behind_ = false;
  }
  if (!behind_.empty()) {
    extend_factor(R_, rows_, behind_, next_, scratch_, level_);
    std::swap(R_, next_);
    behind_.clear();
  }
  return R_;
}

TakenRows::Energies TakenRows::energies(std::span<const double> x,
                                        std::span<const double> y) const {
  if (factored()) {
    const FactorEnergies of = energies_of_factor(R_, x, y, level_);
    return {of.of_x, of.of_y};
  }
  double trace = 0;
  for (int i = 0; i < rows_.k; ++i)
    trace += gram_[static_cast<std::size_t>(i * (rows_.stride + 1))];
  // Sums of products may cancel: what they may be off by is part of the bounds.
  const double rounding = (64 * rows_.k + 4096) * std::numeric_limits<double>::epsilon() * trace;
  return {quadratic_form(gram_, x, rows_.k, rows_.stride) + rounding,
          std::max(0.0, quadratic_form(gram_, y, rows_.k, rows_.stride) - rounding)};
}

}  // namespace lightrig
