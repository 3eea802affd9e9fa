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
  // V lies by columns: eight of them at a time fill one line of the packed row.
  for (int first = 0; first < rows.k; first += 8) {
    const int last = std::min(rows.k, first + 8);
    double* out = rows.data.data() + first;
    for (const std::int32_t cell : cells) {
      for (int c = 0; c < rows.per_cell; ++c, out += rows.stride) {
        const double* in = basis.V.data() + basis.row(cell, c);
        for (int j = first; j < last; ++j) {
          const double v = in[j * basis.V.rows()];
          out[j - first] = scale.empty() ? v : v * scale[static_cast<std::size_t>(j)];
        }
      }
    }
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
      seen_packed_(grid_cell_.size(), 0),
      bins_(bins) {
  rows_ = pack(basis, grid_cell_, scale);
  std::vector<std::int32_t> packed(seen_.size(), -1);
  for (std::size_t u = 0; u < grid_cell_.size(); ++u) {
    packed[static_cast<std::size_t>(grid_cell_[u])] = static_cast<std::int32_t>(u);
  }
  fresh_.resize(bins.cell.size());
  const auto n = static_cast<std::size_t>(bins.candidates());
  count_.resize(n);
  group_of_.assign(n, 0);
  std::vector<int> group_of_column(static_cast<std::size_t>(bins.grid.n_d), -1);
  for (std::size_t i = 0; i < n; ++i) {
    std::int32_t* out = fresh_.data() + offset_[i];
    std::int64_t columns = 0;
    for (const std::int32_t cell : bins.of(static_cast<int>(i))) {
      *out++ = packed[static_cast<std::size_t>(cell)];
      columns += bins.grid.column_d(cell);
    }
    count_[i] = static_cast<std::int32_t>(offset_[i + 1] - offset_[i]);
    if (count_[i] == 0) continue;
    std::sort(out - count_[i], out);
    int& group = group_of_column[static_cast<std::size_t>(columns / count_[i])];
    if (group < 0) group = groups_++;
    group_of_[i] = group;
  }
  groups_ = std::max(1, groups_);
}

std::vector<std::int32_t> CandidateGroups::take(int candidate) {
  const std::span<const std::int32_t> added = fresh(candidate);
  std::vector<std::int32_t> cells(added.begin(), added.end());
  for (const std::int32_t cell : cells) {
    seen_packed_[static_cast<std::size_t>(cell)] = 1;
    seen_[static_cast<std::size_t>(grid_cell_[static_cast<std::size_t>(cell)])] = 1;
  }
  seen_cells_ += static_cast<int>(cells.size());
  for (std::size_t i = 0; i < count_.size(); ++i) {
    std::int32_t* first = fresh_.data() + offset_[i];
    const std::int32_t* last = std::remove_if(first, first + count_[i], [&](std::int32_t cell) {
      return seen_packed_[static_cast<std::size_t>(cell)] != 0;
    });
    count_[i] = static_cast<std::int32_t>(last - first);
  }
  return cells;
}

CandidateGroups::Distinct CandidateGroups::distinct(const std::vector<std::uint8_t>& open) const {
  struct Entry {
    std::uint64_t hash;
    int candidate;
  };
  Distinct found;
  std::vector<Entry> entries;
  for (int i = 0; i < candidates(); ++i) {
    if (open[static_cast<std::size_t>(i)] == 0) continue;
    if (bins_.of(i).empty()) ++found.empty;
    if (!fresh(i).empty()) entries.push_back({hash_of(fresh(i)), i});
  }
  std::sort(entries.begin(), entries.end(), [](const Entry& a, const Entry& b) {
    return a.hash != b.hash ? a.hash < b.hash : a.candidate < b.candidate;
  });
  std::vector<int> first_of_kind;
  for (std::size_t i = 0; i < entries.size();) {
    std::size_t end = i;
    const std::size_t kinds = first_of_kind.size();
    for (; end < entries.size() && entries[end].hash == entries[i].hash; ++end) {
      // Equal hashes are compared in full: a merge is never a guess.
      const std::span<const std::int32_t> cells = fresh(entries[end].candidate);
      const bool known = std::any_of(
          first_of_kind.begin() + static_cast<std::ptrdiff_t>(kinds), first_of_kind.end(),
          [&](int other) { return std::ranges::equal(cells, fresh(other)); });
      if (known) {
        ++found.identical;
      } else {
        first_of_kind.push_back(entries[end].candidate);
      }
    }
    i = end;
  }
  std::sort(first_of_kind.begin(), first_of_kind.end());
  found.members.resize(static_cast<std::size_t>(groups_));
  found.cells.resize(static_cast<std::size_t>(groups_));
  for (const int i : first_of_kind) {
    found.members[static_cast<std::size_t>(group_of(i))].push_back(i);
  }
  std::vector<int> stamp(grid_cell_.size(), -1);
  for (int g = 0; g < groups_; ++g) {
    std::vector<std::int32_t>& cells = found.cells[static_cast<std::size_t>(g)];
    for (const int i : found.members[static_cast<std::size_t>(g)]) {
      for (const std::int32_t cell : fresh(i)) {
        int& mark = stamp[static_cast<std::size_t>(cell)];
        if (mark == g) continue;
        mark = g;
        cells.push_back(cell);
      }
    }
  }
  return found;
}

}  // namespace lightrig
