#include "core/group_extremes.h"

#include <algorithm>
#include <cmath>

#include "core/parallel.h"
#include "core/planner_kernels.h"

namespace lightrig {

namespace {

/// Iterations at most, and the relative change of the quotients below which they are good enough: a
/// bound needs no more, and the candidates that it leaves are looked at by themselves.
constexpr int most_iterations = 12;
constexpr double settled = 1e-3;

/// The lower triangle of an upper one (k × stride), row by row, every `step`-th number of `out`.
void lower_of(std::span<const double> upper, int k, int stride, double* out, int step, bool less) {
  for (int i = 0; i < k; ++i) {
    for (int j = 0; j <= i; ++j, out += step) {
      const double v = upper[static_cast<std::size_t>(j) * static_cast<std::size_t>(stride) +
                             static_cast<std::size_t>(i)];
      *out = less ? *out - v : v;
    }
  }
}

}  // namespace

GroupExtremes::GroupExtremes(const CandidateGroups& groups, int threads, int level)
    : groups_(groups),
      k_(groups.rows().k),
      stride_(groups.rows().stride),
      threads_(threads),
      level_(level),
      found_(static_cast<std::size_t>(groups.groups())) {
  gram_.assign(batches() * batch_matrix_size(k_), 0.0);
  x_.assign(batches() * batch_vector_size(k_), 0.0);
  for (std::size_t i = 0; i < x_.size(); ++i) {
    // Any start with a part in every direction will do.
    const auto component = static_cast<double>(i % batch_vector_size(k_) / batch_size);
    x_[i] = (1 + 0.5 * std::sin(1.0 + 3.0 * component)) / std::sqrt(static_cast<double>(k_));
  }
  y_ = x_;
  taken_.assign(batch_index(k_, 0), 0.0);
  leaving_.assign(groups.seen_packed().size(), 0);
  work_.resize(static_cast<std::size_t>(threads));
  for (Work& work : work_) {
    work.A.resize(batch_matrix_size(k_));
    work.factor.resize(batch_matrix_size(k_));
    work.inverse.resize(batch_vector_size(k_));
    work.z.resize(batch_vector_size(k_));
    work.gram.resize(static_cast<std::size_t>(k_) * static_cast<std::size_t>(stride_));
    work.cells.reserve(leaving_.size());
  }
  parallel_ranges(groups.groups(), batch_size, threads_,
                  [&](std::int64_t first, std::int64_t last, int worker) {
                    for (int g = static_cast<int>(first); g < static_cast<int>(last); ++g) {
                      sum_group(g, work_[static_cast<std::size_t>(worker)]);
                    }
                  });
}

double* GroupExtremes::lane(std::vector<double>& of, std::size_t size, int group) const {
  const auto g = static_cast<std::size_t>(group);
  return of.data() + g / batch_size * size + g % batch_size;
}

/// B of a group from its unseen rows.
void GroupExtremes::sum_group(int g, Work& work) {
  work.cells.clear();
  for (const std::int32_t cell : groups_.cells_of_group(g)) {
    if (!groups_.packed_seen(cell)) work.cells.push_back(cell);
  }
  std::fill(work.gram.begin(), work.gram.end(), 0.0);
  add_gram(groups_.rows(), work.cells, work.gram, level_);
  lower_of(work.gram, k_, stride_, lane(gram_, batch_matrix_size(k_), g), batch_size, false);
}

/// B of a group without the rows that are leaving, by whichever rows are fewer. What it loses in
/// digits only moves vectors and, by no more than the room that bounds have, their quotients.
void GroupExtremes::take_from(int g, Work& work) {
  work.cells.clear();
  std::size_t left = 0;
  for (const std::int32_t cell : groups_.cells_of_group(g)) {
    if (leaving_[static_cast<std::size_t>(cell)] != 0) {
      work.cells.push_back(cell);
    } else {
      left += groups_.packed_seen(cell) ? 0U : 1U;
    }
  }
  if (work.cells.empty()) return;
  if (8 * work.cells.size() > left) return sum_group(g, work);
  std::fill(work.gram.begin(), work.gram.end(), 0.0);
  add_gram(groups_.rows(), work.cells, work.gram, level_);
  lower_of(work.gram, k_, stride_, lane(gram_, batch_matrix_size(k_), g), batch_size, true);
}

void GroupExtremes::take(std::span<const std::int32_t> cells) {
  for (const std::int32_t cell : cells) leaving_[static_cast<std::size_t>(cell)] = 1;
  std::vector<int> losing;
  for (int g = 0; g < groups_.groups(); ++g) {
    const auto of_group = groups_.cells_of_group(g);
    if (std::any_of(of_group.begin(), of_group.end(), [&](std::int32_t cell) {
          return leaving_[static_cast<std::size_t>(cell)] != 0;
        })) {
      losing.push_back(g);
    }
  }
  for (const int g : losing) {
    if (std::any_of(originals_.begin(), originals_.end(),
                    [&](const Original& o) { return o.group == g; })) {
      continue;
    }
    Original original{g, std::vector<double>(batch_index(k_, 0))};
    const double* from = lane(gram_, batch_matrix_size(k_), g);
    for (std::size_t i = 0; i < original.lower.size(); ++i)
      original.lower[i] = from[i * batch_size];
    originals_.push_back(std::move(original));
  }
  parallel_ranges(static_cast<std::int64_t>(losing.size()), 4, threads_,
                  [&](std::int64_t first, std::int64_t last, int worker) {
                    for (auto i = static_cast<std::size_t>(first);
                         i < static_cast<std::size_t>(last); ++i) {
                      take_from(losing[i], work_[static_cast<std::size_t>(worker)]);
                    }
                  });
  for (const std::int32_t cell : cells) leaving_[static_cast<std::size_t>(cell)] = 0;
}

void GroupExtremes::restart() {
  for (const Original& original : originals_) {
    double* to = lane(gram_, batch_matrix_size(k_), original.group);
    for (std::size_t i = 0; i < original.lower.size(); ++i) to[i * batch_size] = original.lower[i];
  }
  originals_.clear();
}

void GroupExtremes::look(std::span<const double> taken, const std::function<void(int)>& then) {
  lower_of(taken, k_, stride_, taken_.data(), 1, false);
  parallel_ranges(groups_.groups(), batch_size, threads_,
                  [&](std::int64_t first, std::int64_t last, int worker) {
                    look_at(static_cast<std::size_t>(first) / batch_size,
                            work_[static_cast<std::size_t>(worker)]);
                    for (int g = static_cast<int>(first); g < static_cast<int>(last); ++g) then(g);
                  });
}

/// y towards the greatest eigenvector of work.A, from where it was. `scale` is what each lane's
/// matrix was multiplied by.
void GroupExtremes::iterate_greatest(std::size_t batch, std::span<const double> scale, Work& work) {
  const std::span<double> y =
      std::span(y_).subspan(batch * batch_vector_size(k_), batch_vector_size(k_));
  double sums[batch_size], last[batch_size] = {};
  for (int i = 0; i < most_iterations; ++i) {
    batch_multiply(work.A, k_, y, work.z, level_);
    batch_dot(work.z, work.z, sums, level_);
    bool done = i > 0;
    for (int lane = 0; lane < batch_size; ++lane) {
      const double length = std::sqrt(sums[lane]);
      if (length - last[lane] > settled * length) done = false;
      last[lane] = length;
      sums[lane] = 1 / length;
    }
    batch_scale(work.z, sums, level_);
    std::copy(work.z.begin(), work.z.end(), y.begin());
    if (done) break;
  }
  // |Ay| is at most the quotient of the vector that it leads to.
  for (std::size_t lane = 0; lane < batch_size; ++lane) {
    const std::size_t g = batch * batch_size + lane;
    if (g < found_.size()) found_[g].high = last[lane] / scale[lane];
  }
}

/// x towards the least eigenvector of work.A, whose factor is there, from where it was; what is
/// found of the batch's groups.
void GroupExtremes::iterate_least(std::size_t batch, std::span<const double> scale, Work& work) {
  const std::span<double> x =
      std::span(x_).subspan(batch * batch_vector_size(k_), batch_vector_size(k_));
  double along[batch_size], squares[batch_size], last[batch_size];
  std::fill_n(last, batch_size, std::numeric_limits<double>::infinity());
  for (int i = 0; i < most_iterations; ++i) {
    std::copy(x.begin(), x.end(), work.z.begin());
    batch_solve(work.factor, k_, work.inverse, work.z, level_);
    batch_dot(work.z, x, along, level_);
    batch_dot(work.z, work.z, squares, level_);
    bool done = i > 0;
    for (int lane = 0; lane < batch_size; ++lane) {
      const double quotient = along[lane] / squares[lane];  // of z: zᵀAz = zᵀx
      if (last[lane] - quotient > settled * quotient) done = false;
      last[lane] = quotient;
      squares[lane] = 1 / std::sqrt(squares[lane]);
    }
    batch_scale(work.z, squares, level_);
    std::copy(work.z.begin(), work.z.end(), x.begin());
    if (done) break;
  }
  // The matrix has trace 1: its sums and the solutions are off by no more than this.
  const double room = (64 * k_ + 4096) * std::numeric_limits<double>::epsilon();
  for (std::size_t lane = 0; lane < batch_size; ++lane) {
    const std::size_t g = batch * batch_size + lane;
    if (g >= found_.size()) break;
    found_[g].known = last[lane] > room && std::isfinite(last[lane]) && std::isfinite(scale[lane]);
    found_[g].low = last[lane] / scale[lane];
    found_[g].rounding = room / scale[lane];
  }
}

void GroupExtremes::look_at(std::size_t batch, Work& work) {
  const double* B = gram_.data() + batch * batch_matrix_size(k_);
  double scale[batch_size] = {};
  for (std::size_t i = 0; i < taken_.size(); ++i) {
    for (std::size_t lane = 0; lane < batch_size; ++lane) {
      work.A[i * batch_size + lane] = taken_[i] + B[i * batch_size + lane];
    }
  }
  for (int i = 0; i < k_; ++i) {
    for (std::size_t lane = 0; lane < batch_size; ++lane) {
      scale[lane] += work.A[batch_index(i, i) * batch_size + lane];
    }
  }
  for (double& s : scale) s = 1 / s;
  batch_scale(work.A, scale, level_);
  std::copy(work.A.begin(), work.A.end(), work.factor.begin());
  batch_factor(work.factor, k_, work.inverse, level_);
  iterate_greatest(batch, scale, work);
  iterate_least(batch, scale, work);
  // A lane that broke down starts anew, and next time has a chance.
  for (std::size_t lane = 0; lane < batch_size; ++lane) {
    const std::size_t g = batch * batch_size + lane;
    double least_pivot = std::numeric_limits<double>::infinity();
    for (int i = 0; i < k_; ++i) {
      const double pivot = work.factor[batch_index(i, i) * batch_size + lane];
      least_pivot = pivot > 0 ? std::min(least_pivot, pivot) : 0;
      if (!(pivot > 0)) break;
    }
    if (g < found_.size() && !(least_pivot > 0)) found_[g].known = false;
    if (g < found_.size() && found_[g].known) continue;
    double* x = x_.data() + batch * batch_vector_size(k_) + lane;
    double* y = y_.data() + batch * batch_vector_size(k_) + lane;
    for (int i = 0; i < k_; ++i) {
      x[i * batch_size] = y[i * batch_size] =
          (1 + 0.5 * std::sin(1.0 + 3.0 * i)) / std::sqrt(static_cast<double>(k_));
    }
  }
}

void GroupExtremes::add_group(int g, std::span<double> A) const {
  const auto u = static_cast<std::size_t>(g);
  const double* from = gram_.data() + u / batch_size * batch_matrix_size(k_) + u % batch_size;
  for (int i = 0; i < k_; ++i) {
    for (int j = 0; j <= i; ++j, from += batch_size) {
      A[static_cast<std::size_t>(j) * static_cast<std::size_t>(stride_) +
        static_cast<std::size_t>(i)] += *from;
    }
  }
}

void GroupExtremes::copy_vectors(int g, std::span<double> x, std::span<double> y) const {
  const auto u = static_cast<std::size_t>(g);
  const std::size_t from = u / batch_size * batch_vector_size(k_) + u % batch_size;
  for (std::size_t i = 0; i < static_cast<std::size_t>(k_); ++i) {
    x[i] = x_[from + i * batch_size];
    y[i] = y_[from + i * batch_size];
  }
}

}  // namespace lightrig
