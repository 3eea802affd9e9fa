#include "bench/planner_floor.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstdio>
#include <ctime>
#include <set>
#include <vector>

#include "core/lanes.h"
#include "core/planner_kernels.h"

namespace lightrig::bench {

namespace {

double cpu_seconds() {
  timespec t{};
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
  return static_cast<double>(t.tv_sec) + 1e-9 * static_cast<double>(t.tv_nsec);
}

/// x ← a x + b in sixteen registers of eight that do not wait for one another.
[[gnu::always_inline]] inline double multiply_add(int times) {
  constexpr int registers = 16;
  Lanes x[registers];
  for (int r = 0; r < registers; ++r) x[r] = Lanes{} + (1.0 + r);
  const Lanes a = Lanes{} + 0.999, b = Lanes{} + 0.001;
  for (int i = 0; i < times; ++i) {
#pragma GCC unroll 16
    for (int r = 0; r < registers; ++r) x[r] = x[r] * a + b;
  }
  double sum = 0;
  for (const Lanes& one : x) sum += sum_of(one);
  return sum;
}

/// Rows of the distinct candidates, taken up once, and of those that leave a candidate's sum since
/// a chosen light showed them, by whichever are fewer, these or those that stay.
struct RowsTaken {
  double taken_up = 0, taken_out = 0;
};

RowsTaken rows_taken(const CandidateBins& bins, const Selection& plan, double per_cell) {
  std::vector<std::uint8_t> seen(static_cast<std::size_t>(bins.grid.cells()), 0);
  std::vector<std::uint8_t> leaving = seen;
  RowsTaken rows;
  for (std::size_t step = 0; step < plan.lights.size(); ++step) {
    std::set<std::vector<std::int32_t>> distinct;
    for (int i = 0; i < bins.candidates(); ++i) {
      std::vector<std::int32_t> fresh;
      double gone = 0;
      for (const std::int32_t cell : bins.of(i)) {
        const auto c = static_cast<std::size_t>(cell);
        if (seen[c] == 0) fresh.push_back(cell);
        gone += leaving[c] != 0 ? 1 : 0;
      }
      const auto left = static_cast<double>(fresh.size());
      if (fresh.empty() || !distinct.insert(std::move(fresh)).second) continue;
      (step == 0 ? rows.taken_up : rows.taken_out) +=
          per_cell * (step == 0 ? left : std::min(left, gone));
    }
    std::fill(leaving.begin(), leaving.end(), 0);
    for (const std::int32_t cell : bins.of(plan.lights[step].candidate)) {
      const auto c = static_cast<std::size_t>(cell);
      leaving[c] = seen[c] == 0 ? 1 : 0;
      seen[c] = 1;
    }
  }
  return rows;
}

}  // namespace

void Machine::measure() {
  const std::vector<double> memory(std::size_t{1} << 24, 1.0);  // 128 MiB
  static volatile double needed = 0;                            // what is computed is needed
  for (int i = 0; i < 4; ++i) {
    const double start = cpu_seconds();
    needed = Eigen::Map<const Eigen::VectorXd>(memory.data(), Eigen::Index{1} << 24).sum();
    bandwidth =
        std::max(bandwidth, static_cast<double>(8 * memory.size()) / (cpu_seconds() - start));
  }
  for (int i = 0; i < 20; ++i) {
    constexpr int times = 20000;
    const double start = cpu_seconds();
    needed = on_level(
        vector_level(), [&]() __attribute__((always_inline)) { return multiply_add(times); });
    if (needed == 0) std::puts("");  // what is computed is needed
    flops = std::max(flops, 2.0 * 16 * lane_width * times / (cpu_seconds() - start));
  }
}

Floors print_floors(const BrdfBasis& basis, const CandidateBins& bins, const Selection& plan,
                    double points, double lit, const Machine& machine) {
  const double K = static_cast<double>(basis.components());
  const double per_cell = basis.layout == ChannelLayout::stacked ? basis.channels : 1;
  std::vector<std::int32_t> used = bins.cell;
  std::sort(used.begin(), used.end());
  used.erase(std::unique(used.begin(), used.end()), used.end());
  const double rows = per_cell * static_cast<double>(used.size());
  const double filled = static_cast<double>(bins.cell.size());
  const double lights = static_cast<double>(plan.lights.size());
  double added = 0;
  for (const SelectedLight& light : plan.lights) added += per_cell * light.new_cells;
  const RowsTaken taken = rows_taken(bins, plan, per_cell);
  const double bytes = 8 * 3 * points + 8 * rows * K + 4 * filled;
  const double spectra = lights * 4.0 / 3 * K * K * K;
  const double scoring = 5 * lit + (taken.taken_up + taken.taken_out) * K * (K + 1) + spectra;
  const double knowing = 5 * points + added * K * (K + 1) + spectra;
  const double reading = bytes / machine.bandwidth;
  const Floors floors{std::max(reading, scoring / machine.flops),
                      std::max(reading, knowing / machine.flops)};
  fmt::print(
      "floors = max(bytes / bandwidth, operations / rate) at {:.1f} GB/s and {:.1f} G/s, measured "
      "in this run\n"
      "  bytes of both = 8·3·points + 8·rows·K + 4·filled = {:.1f} MB: {:.5f} s; points {} (facing "
      "the camera) rows {} (distinct) filled {}\n"
      "A: a greedy that scores every distinct candidate once per light: {:.5f} s\n"
      "  operations = 5·lit + (up + out)·K·(K + 1) + lights·4/3·K³ = {:.1f} M; lit {} (pairs of "
      "candidate and point) up {} out {} (rows into and out of candidates' sums)\n"
      "B: an oracle that knows each winner beforehand: {:.5f} s\n"
      "  operations = 5·points + added·K·(K + 1) + lights·4/3·K³ = {:.1f} M; added {} (rows of the "
      "lights chosen)\n",
      machine.bandwidth / 1e9, machine.flops / 1e9, bytes / 1e6, reading, points, rows, filled,
      floors.greedy, scoring / 1e6, lit, taken.taken_up, taken.taken_out, floors.oracle,
      knowing / 1e6, added);
  return floors;
}

}  // namespace lightrig::bench
