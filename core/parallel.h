#pragma once

#include <algorithm>
#include <atomic>
#include <cstdint>
#include <thread>
#include <vector>

namespace lightrig {

/// Calls work(first, last, worker) for consecutive ranges that together cover 0 … count − 1, on up
/// to `threads` threads, all joined before it returns. Which worker gets which range is not fixed:
/// what `work` computes for an index may not depend on it.
template <class Work>
void parallel_ranges(std::int64_t count, std::int64_t grain, int threads, const Work& work) {
  const std::int64_t ranges = (count + grain - 1) / grain;
  const int workers =
      static_cast<int>(std::clamp<std::int64_t>(threads, 1, std::max<std::int64_t>(1, ranges)));
  std::atomic<std::int64_t> next{0};
  const auto run = [&](int worker) {
    for (std::int64_t range = next++; range < ranges; range = next++) {
      work(range * grain, std::min(count, (range + 1) * grain), worker);
    }
  };
  std::vector<std::jthread> others;
  for (int worker = 1; worker < workers; ++worker) others.emplace_back(run, worker);
  run(0);
}

}  // namespace lightrig
