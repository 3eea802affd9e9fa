#include "core/candidate_groups.h"

#include <algorithm>
#include <cstddef>
#include <numeric>

namespace lightrig {

namespace {

/// The cells that occur at all, those of one θd column side by side.
std::vector<std::int32_t> cells_in_use(const CandidateBins& bins) {
  std::vector<std::uint8_t> used(static_cast<std::size_t>(bins.grid.cells()), 0);
  for (const std::int32_t cell : bins.cell) used[static_cast<std::size_t>(cell)] = 1;
  std::vector<std::int32_t> cells;
  for (int d = 0; d < bins.grid.n_d; ++d) {
    for (int h = 0; h < bins.grid.n_h; ++h) {
      const int cell = bins.grid.cell(h, d);
      if (used[static_cast<std::size_t>(cell)] != 0) cells.push_back(cell);
    }
  }
  return cells;
}

PackedRows pack(const BrdfBasis& basis, std::span<const std::int32_t> cells,
                std::span<const double> scale) {
  PackedRows rows;
  rows.k = static_cast<int>(basis.components());
  rows.stride = (rows.k + 7) / 8 * 8;
  rows.per_cell = basis.layout == ChannelLayout::stacked ? basis.channels : 1;
  const std::size_t count = cells.size() * static_cast<std::size_t>(rows.per_cell);
  rows.data.assign(count * static_cast<std::size_t>(rows.stride), 0.0);
  // V lies by columns, a θd column's cells n_d apart: eight columns of V and eight of θd at a time
  // use whole lines of both.
  const int n_d = basis.grid.n_d;
  for (std::size_t begin = 0; begin < cells.size();) {
    std::size_t end = begin;
    const int block = basis.grid.column_d(cells[begin]) / 8;
    while (end < cells.size() && cells[end] % n_d / 8 == block) ++end;
    for (int first = 0; first < rows.k; first += 8) {
      const int last = std::min(rows.k, first + 8);
      double* out = rows.data.data() +
                    static_cast<std::ptrdiff_t>(begin) * rows.per_cell * rows.stride + first;
      for (const std::int32_t cell : cells.subspan(begin, end - begin)) {
        for (int c = 0; c < rows.per_cell; ++c, out += rows.stride) {
          const double* in = basis.V.data() + basis.row(cell, c);
          for (int j = first; j < last; ++j) {
            const double v = in[j * basis.V.rows()];
            out[j - first] = scale.empty() ? v : v * scale[static_cast<std::size_t>(j)];
          }
        }
      }
    }
    begin = end;
  }
  return rows;
}

std::uint64_t hash_of(std::span<const std::int32_t> cells) {
  std::uint64_t hash = 0x9e3779b97f4a7c15;
  for (const std::int32_t cell : cells) {
    hash = (hash ^ static_cast<std::uint64_t>(cell)) * std::uint64_t{0xff51afd7ed558ccd};
    hash ^= hash >> 29;
  }
  return hash;
}

}  // namespace

CandidateGroups::CandidateGroups(const BrdfBasis& basis, const CandidateBins& bins,
                                 std::span<const double> scale)
    : grid_cell_(cells_in_use(bins)),
      offset_(bins.offset),
      seen_(static_cast<std::size_t>(bins.grid.cells()), 0),
      seen_packed_(grid_cell_.size(), 0) {
  rows_ = pack(basis, grid_cell_, scale);
  std::vector<std::int32_t> packed(seen_.size(), -1);
  for (std::size_t u = 0; u < grid_cell_.size(); ++u) {
    packed[static_cast<std::size_t>(grid_cell_[u])] = static_cast<std::int32_t>(u);
  }
  group(bins, packed);
  lay_places();
  all_fresh_ = fresh_;
  all_places_ = place_;
  const std::size_t n = count_.size();
  hash_.assign(n, 0);
  entries_.reserve(n);
  distinct_.candidates.reserve(n);
  distinct_.offset.resize(static_cast<std::size_t>(groups_) + 1);
  taken_.reserve(grid_cell_.size());
}

/// What each candidate shows, as packed cells, and its group.
void CandidateGroups::group(const CandidateBins& bins, const std::vector<std::int32_t>& packed) {
  const auto n = static_cast<std::size_t>(bins.candidates());
  fresh_.resize(bins.cell.size());
  count_.resize(n);
  group_of_.assign(n, 0);
  std::vector<std::int32_t> column(static_cast<std::size_t>(bins.grid.cells()));
  for (std::size_t c = 0; c < column.size(); ++c) {
    column[c] = bins.grid.column_d(static_cast<int>(c));
  }
  std::vector<int> group_of_column(static_cast<std::size_t>(bins.grid.n_d), -1);
  for (std::size_t i = 0; i < n; ++i) {
    std::int32_t* const out = fresh_.data() + offset_[i];
    std::int32_t* end = out;
    std::int64_t columns = 0;
    for (const std::int32_t cell : bins.of(static_cast<int>(i))) {
      *end++ = packed[static_cast<std::size_t>(cell)];
      columns += column[static_cast<std::size_t>(cell)];
    }
    count_[i] = static_cast<std::int32_t>(end - out);
    if (count_[i] == 0) continue;
    if (!std::is_sorted(out, end)) std::sort(out, end);
    group_of_[i] = static_cast<int>(columns / count_[i]);
    group_of_column[static_cast<std::size_t>(group_of_[i])] = 0;
  }
  for (int& group : group_of_column) {
    if (group == 0) group = groups_++;
  }
  for (std::size_t i = 0; i < n; ++i) {
    group_of_[i] = count_[i] > 0 ? group_of_column[static_cast<std::size_t>(group_of_[i])] : 0;
  }
  groups_ = std::max(1, groups_);
}

/// The cells of each group, and where those of its candidates stand among them.
void CandidateGroups::lay_places() {
  std::vector<std::vector<int>> members(static_cast<std::size_t>(groups_));
  for (int i = 0; i < candidates(); ++i) {
    members[static_cast<std::size_t>(group_of(i))].push_back(i);
  }
  place_.resize(fresh_.size());
  std::vector<std::int32_t> place(grid_cell_.size(), -1);
  group_offset_.push_back(0);
  for (const std::vector<int>& of_group : members) {
    const auto begin = static_cast<std::ptrdiff_t>(group_cell_.size());
    for (const int i : of_group) {
      for (const std::int32_t cell : fresh(i)) {
        std::int32_t& known = place[static_cast<std::size_t>(cell)];
        if (known >= 0) continue;
        known = 0;
        group_cell_.push_back(cell);
      }
    }
    std::sort(group_cell_.begin() + begin, group_cell_.end());
    const std::span<std::int32_t> cells =
        std::span(group_cell_).subspan(static_cast<std::size_t>(begin));
    for (std::size_t p = 0; p < cells.size(); ++p) {
      place[static_cast<std::size_t>(cells[p])] = static_cast<std::int32_t>(p);
    }
    for (const int i : of_group) {
      std::int32_t* out = place_.data() + offset_[static_cast<std::size_t>(i)];
      for (const std::int32_t cell : fresh(i)) *out++ = place[static_cast<std::size_t>(cell)];
    }
    for (const std::int32_t cell : cells) place[static_cast<std::size_t>(cell)] = -1;
    group_offset_.push_back(group_cell_.size());
  }
}

void CandidateGroups::restart() {
  std::copy(all_fresh_.begin(), all_fresh_.end(), fresh_.begin());
  std::copy(all_places_.begin(), all_places_.end(), place_.begin());
  for (std::size_t i = 0; i < count_.size(); ++i) {
    const auto count = static_cast<std::int32_t>(offset_[i + 1] - offset_[i]);
    if (count_[i] != count) hash_[i] = 0;
    count_[i] = count;
  }
  std::fill(seen_.begin(), seen_.end(), 0);
  std::fill(seen_packed_.begin(), seen_packed_.end(), 0);
  seen_cells_ = 0;
}

std::span<const std::int32_t> CandidateGroups::take(std::span<const int> candidates) {
  taken_.clear();
  for (const int candidate : candidates) {
    for (const std::int32_t cell : fresh(candidate)) {
      if (seen_packed_[static_cast<std::size_t>(cell)] != 0) continue;
      seen_packed_[static_cast<std::size_t>(cell)] = 1;
      seen_[static_cast<std::size_t>(grid_cell_[static_cast<std::size_t>(cell)])] = 1;
      taken_.push_back(cell);
    }
  }
  seen_cells_ += static_cast<int>(taken_.size());
  for (std::size_t i = 0; i < count_.size(); ++i) {
    std::int32_t* cell = fresh_.data() + offset_[i];
    std::int32_t* place = place_.data() + offset_[i];
    std::int32_t kept = 0;
    for (std::int32_t c = 0; c < count_[i]; ++c) {
      cell[kept] = cell[c];
      place[kept] = place[c];
      kept += seen_packed_[static_cast<std::size_t>(cell[c])] == 0 ? 1 : 0;
    }
    if (kept == count_[i]) continue;
    count_[i] = kept;
    hash_[i] = 0;
  }
  return taken_;
}

const CandidateGroups::Distinct& CandidateGroups::distinct(const std::vector<std::uint8_t>& open) {
  distinct_.identical = 0;
  distinct_.empty = 0;
  entries_.clear();
  for (int i = 0; i < candidates(); ++i) {
    const auto u = static_cast<std::size_t>(i);
    if (open[u] == 0) continue;
    if (offset_[u] == offset_[u + 1]) ++distinct_.empty;
    if (count_[u] == 0) continue;
    if (hash_[u] == 0) hash_[u] = hash_of(fresh(i));
    entries_.push_back({hash_[u], i});
  }
  std::sort(entries_.begin(), entries_.end(), [](const Entry& a, const Entry& b) {
    return a.hash != b.hash ? a.hash < b.hash : a.candidate < b.candidate;
  });
  std::vector<int>& first_of_kind = distinct_.candidates;
  first_of_kind.clear();
  for (std::size_t i = 0; i < entries_.size();) {
    std::size_t end = i;
    const std::size_t kinds = first_of_kind.size();
    for (; end < entries_.size() && entries_[end].hash == entries_[i].hash; ++end) {
      // Equal hashes are compared in full: a merge is never a guess.
      const std::span<const std::int32_t> cells = fresh(entries_[end].candidate);
      const bool known = std::any_of(
          first_of_kind.begin() + static_cast<std::ptrdiff_t>(kinds), first_of_kind.end(),
          [&](int other) { return std::ranges::equal(cells, fresh(other)); });
      if (known) {
        ++distinct_.identical;
      } else {
        first_of_kind.push_back(entries_[end].candidate);
      }
    }
    i = end;
  }
  std::sort(first_of_kind.begin(), first_of_kind.end(), [&](int a, int b) {
    return group_of(a) != group_of(b) ? group_of(a) < group_of(b) : a < b;
  });
  std::fill(distinct_.offset.begin(), distinct_.offset.end(), 0);
  for (const int i : first_of_kind) ++distinct_.offset[static_cast<std::size_t>(group_of(i)) + 1];
  std::partial_sum(distinct_.offset.begin(), distinct_.offset.end(), distinct_.offset.begin());
  return distinct_;
}

}  // namespace lightrig
