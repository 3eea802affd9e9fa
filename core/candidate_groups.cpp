#include "core/candidate_groups.h"

#include <algorithm>
#include <cstddef>
#include <numeric>

#include "core/parallel.h"

namespace lightrig {

namespace {

/// In seen_packed_, while a light is being taken: seen from now on.
constexpr std::uint8_t leaving = 2;

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

/// The rows of some cells, one after another, from `to` on; what is beyond the k-th is 0.
void pack_block(const BrdfBasis& basis, std::span<const std::int32_t> cells,
                std::span<const double> scale, const PackedRows& rows, double* to) {
  for (int first = 0; first < rows.stride; first += 8) {
    const int last = std::min(rows.k, first + 8);
    double* out = to + first;
    for (const std::int32_t cell : cells) {
      for (int c = 0; c < rows.per_cell; ++c, out += rows.stride) {
        const double* in = basis.V.data() + basis.row(cell, c);
        for (int j = first; j < last; ++j) {
          const double v = in[j * basis.V.rows()];
          out[j - first] = scale.empty() ? v : v * scale[static_cast<std::size_t>(j)];
        }
        std::fill(out + (last - first), out + 8, 0.0);
      }
    }
  }
}

PackedRows pack(const BrdfBasis& basis, std::span<const std::int32_t> cells,
                std::span<const double> scale, int threads) {
  PackedRows rows;
  rows.k = static_cast<int>(basis.components());
  rows.stride = (rows.k + 7) / 8 * 8;
  rows.per_cell = basis.layout == ChannelLayout::stacked ? basis.channels : 1;
  const std::size_t count = cells.size() * static_cast<std::size_t>(rows.per_cell);
  rows.data.resize(count * static_cast<std::size_t>(rows.stride));
  // V lies by columns, a θd column's cells n_d apart: eight columns of V and eight of θd at a time
  // use whole lines of both.
  const int n_d = basis.grid.n_d;
  std::vector<std::size_t> block = {0};
  for (std::size_t begin = 0; begin < cells.size(); block.push_back(begin)) {
    const int eight = basis.grid.column_d(cells[begin]) / 8;
    while (begin < cells.size() && cells[begin] % n_d / 8 == eight) ++begin;
  }
  parallel_ranges(static_cast<std::int64_t>(block.size()) - 1, 1, threads,
                  [&](std::int64_t b, std::int64_t, int) {
                    const std::size_t begin = block[static_cast<std::size_t>(b)];
                    pack_block(basis,
                               cells.subspan(begin, block[static_cast<std::size_t>(b) + 1] - begin),
                               scale, rows,
                               rows.data.data() + static_cast<std::ptrdiff_t>(begin) *
                                                      rows.per_cell * rows.stride);
                  });
  return rows;
}

std::uint64_t hash_of(std::span<const std::int32_t> cells) {
  std::uint64_t hash = 0x9e3779b97f4a7c15;
  for (const std::int32_t cell : cells) {
    hash = (hash ^ static_cast<std::uint64_t>(cell)) * std::uint64_t{0xff51afd7ed558ccd};
    hash ^= hash >> 29;
  }
  return std::max<std::uint64_t>(hash, 1);  // 0 means: not known
}

}  // namespace

CandidateGroups::CandidateGroups(const BrdfBasis& basis, const CandidateBins& bins,
                                 std::span<const double> scale, int threads)
    : grid_cell_(cells_in_use(bins)),
      offset_(bins.offset),
      seen_(static_cast<std::size_t>(bins.grid.cells()), 0),
      seen_packed_(grid_cell_.size(), 0) {
  rows_ = pack(basis, grid_cell_, scale, threads);
  std::vector<std::int32_t> packed(seen_.size(), -1);
  for (std::size_t u = 0; u < grid_cell_.size(); ++u) {
    packed[static_cast<std::size_t>(grid_cell_[u])] = static_cast<std::int32_t>(u);
  }
  group(bins, packed);
  lay_places();
  find_lacks();
  all_fresh_ = fresh_;
  all_places_ = place_;
  const std::size_t n = count_.size();
  hash_.assign(n, 0);
  for (std::vector<Entry>* entries : {&entries_, &changed_, &merged_}) entries->reserve(n);
  first_of_kind_.assign(n, 0);
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
  member_offset_.assign(static_cast<std::size_t>(groups_) + 1, 0);
  for (const int g : group_of_) ++member_offset_[static_cast<std::size_t>(g) + 1];
  std::partial_sum(member_offset_.begin(), member_offset_.end(), member_offset_.begin());
  member_.resize(group_of_.size());
  next_of_group_.assign(member_offset_.begin(), member_offset_.end() - 1);
  for (int i = 0; i < candidates(); ++i) {
    const auto at =
        static_cast<std::size_t>(next_of_group_[static_cast<std::size_t>(group_of(i))]++);
    member_[at] = i;
  }
  place_.resize(fresh_.size());
  std::vector<std::int32_t> place(grid_cell_.size(), -1);
  group_offset_.push_back(0);
  for (int g = 0; g < groups_; ++g) {
    const std::span<const int> of_group = members(g);
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

/// The edges of groups whose candidates lack a quarter of what they show, or less.
void CandidateGroups::find_lacks() {
  const auto n = static_cast<std::size_t>(candidates());
  lacking_.assign(static_cast<std::size_t>(groups_), 0);
  lack_offset_.assign(n, 0);
  lack_count_.assign(n, 0);
  edge_offset_.assign(1, 0);
  std::vector<std::int32_t> shown, at_edge;
  std::vector<std::uint8_t> own;
  for (int g = 0; g < groups_; ++g) {
    const std::span<const std::int32_t> cells = cells_of_group(g);
    shown.assign(cells.size(), 0);
    std::size_t all = 0, holders = 0;
    for (const int i : members(g)) {
      for (const std::int32_t place : places(i)) ++shown[static_cast<std::size_t>(place)];
      all += places(i).size();
      holders += places(i).empty() ? 0U : 1U;
    }
    if (4 * (holders * cells.size() - all) <= all) {
      lacking_[static_cast<std::size_t>(g)] = 1;
      at_edge.assign(cells.size(), -1);
      for (std::size_t p = 0; p < cells.size(); ++p) {
        if (static_cast<std::size_t>(shown[p]) == holders) continue;
        at_edge[p] = static_cast<std::int32_t>(edge_.size() - edge_offset_.back());
        edge_.push_back(cells[p]);
      }
      for (const int i : members(g)) {
        if (places(i).empty()) continue;
        own.assign(cells.size(), 0);
        for (const std::int32_t place : places(i)) own[static_cast<std::size_t>(place)] = 1;
        lack_offset_[static_cast<std::size_t>(i)] = lack_.size();
        for (std::size_t p = 0; p < cells.size(); ++p) {
          if (at_edge[p] >= 0 && own[p] == 0) lack_.push_back(at_edge[p]);
        }
        lack_count_[static_cast<std::size_t>(i)] =
            static_cast<std::int32_t>(lack_.size() - lack_offset_[static_cast<std::size_t>(i)]);
      }
    }
    edge_offset_.push_back(edge_.size());
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

/// Takes what is seen from the lists of a group's candidates.
void CandidateGroups::leave_out_seen(int group) {
  for (const int candidate : members(group)) {
    const auto i = static_cast<std::size_t>(candidate);
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
  for (const std::int32_t cell : taken_) seen_packed_[static_cast<std::size_t>(cell)] = leaving;
  for (int g = 0; g < groups_; ++g) {
    const bool loses = std::ranges::any_of(cells_of_group(g), [&](std::int32_t cell) {
      return seen_packed_[static_cast<std::size_t>(cell)] == leaving;
    });
    if (loses) leave_out_seen(g);
  }
  for (const std::int32_t cell : taken_) seen_packed_[static_cast<std::size_t>(cell)] = 1;
  return taken_;
}

/// Brings entries_ up to date: those of candidates whose cells have changed are made anew and
/// merged with the others.
void CandidateGroups::sort_entries() {
  const auto before = [](const Entry& a, const Entry& b) {
    return a.hash != b.hash ? a.hash < b.hash : a.candidate < b.candidate;
  };
  std::erase_if(entries_, [&](const Entry& entry) {
    return hash_[static_cast<std::size_t>(entry.candidate)] != entry.hash;
  });
  changed_.clear();
  for (int i = 0; i < candidates(); ++i) {
    const auto u = static_cast<std::size_t>(i);
    if (hash_[u] != 0 || count_[u] == 0) continue;
    hash_[u] = hash_of(fresh(i));
    changed_.push_back({hash_[u], i});
  }
  if (changed_.empty()) return;
  std::sort(changed_.begin(), changed_.end(), before);
  merged_.resize(entries_.size() + changed_.size());
  std::merge(entries_.begin(), entries_.end(), changed_.begin(), changed_.end(), merged_.begin(),
             before);
  entries_.swap(merged_);
}

const CandidateGroups::Distinct& CandidateGroups::distinct(const std::vector<std::uint8_t>& open) {
  distinct_.identical = 0;
  distinct_.empty = 0;
  sort_entries();
  std::fill(first_of_kind_.begin(), first_of_kind_.end(), 0);
  for (std::size_t i = 0; i < entries_.size();) {
    std::size_t end = i;
    for (; end < entries_.size() && entries_[end].hash == entries_[i].hash; ++end) {
      const int candidate = entries_[end].candidate;
      if (open[static_cast<std::size_t>(candidate)] == 0) continue;
      // Equal hashes are compared in full: a merge is never a guess.
      const std::span<const std::int32_t> cells = fresh(candidate);
      const bool known =
          std::any_of(entries_.begin() + static_cast<std::ptrdiff_t>(i),
                      entries_.begin() + static_cast<std::ptrdiff_t>(end), [&](const Entry& other) {
                        return first_of_kind_[static_cast<std::size_t>(other.candidate)] != 0 &&
                               std::ranges::equal(cells, fresh(other.candidate));
                      });
      distinct_.identical += known ? 1 : 0;
      first_of_kind_[static_cast<std::size_t>(candidate)] = known ? 0 : 1;
    }
    i = end;
  }
  // By group, by counting: the candidates of one stay in their order.
  std::fill(distinct_.offset.begin(), distinct_.offset.end(), 0);
  for (int i = 0; i < candidates(); ++i) {
    const auto u = static_cast<std::size_t>(i);
    if (open[u] != 0 && offset_[u] == offset_[u + 1]) ++distinct_.empty;
    distinct_.offset[static_cast<std::size_t>(group_of(i)) + 1] += first_of_kind_[u];
  }
  std::partial_sum(distinct_.offset.begin(), distinct_.offset.end(), distinct_.offset.begin());
  distinct_.candidates.resize(static_cast<std::size_t>(distinct_.offset.back()));
  next_of_group_.assign(distinct_.offset.begin(), distinct_.offset.end() - 1);
  for (int i = 0; i < candidates(); ++i) {
    if (first_of_kind_[static_cast<std::size_t>(i)] == 0) continue;
    const auto at =
        static_cast<std::size_t>(next_of_group_[static_cast<std::size_t>(group_of(i))]++);
    distinct_.candidates[at] = i;
  }
  return distinct_;
}

}  // namespace lightrig
