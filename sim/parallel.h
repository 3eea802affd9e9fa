#pragma once

#include <algorithm>
#include <cstdint>
#include <stop_token>
#include <thread>

#include "core/parallel.h"

namespace lightrig::sim {

/// Threads to use when asked for `threads`; 0 asks for as many as the machine has.
inline int thread_count(int threads) {
  const auto machine = static_cast<int>(std::max(1U, std::thread::hardware_concurrency()));
  return threads > 0 ? threads : machine;
}

/// Runs work(i) for every i in [0, count) on so many threads, all joined on return; a stop request
/// leaves the rest undone. Which thread takes which i is open: work(i) may depend on i alone.
template <class Work>
void in_parallel(int threads, int count, const std::stop_token& stop, const Work& work) {
  parallel_ranges(count, 1, threads, [&](std::int64_t i, std::int64_t, int) {
    if (!stop.stop_requested()) work(static_cast<int>(i));
  });
}

}  // namespace lightrig::sim
