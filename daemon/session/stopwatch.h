#pragma once

#include <algorithm>
#include <chrono>
#include <string>
#include <utility>
#include <vector>

#include "daemon/session/prepare.h"

namespace lightrig {

/// Adds the seconds from its making to its stop() or end to a stage of a list of costs.
class Stopwatch {
 public:
  Stopwatch(std::string stage, std::vector<StageCost>& cost)
      : stage_(std::move(stage)), cost_(cost), start_(std::chrono::steady_clock::now()) {}
  ~Stopwatch() { stop(); }
  Stopwatch(const Stopwatch&) = delete;
  Stopwatch& operator=(const Stopwatch&) = delete;

  void stop() {
    if (std::exchange(stopped_, true)) return;
    const std::chrono::duration<double> spent = std::chrono::steady_clock::now() - start_;
    const auto known = std::find_if(cost_.begin(), cost_.end(),
                                    [&](const StageCost& s) { return s.stage == stage_; });
    if (known != cost_.end()) {
      known->seconds += spent.count();
    } else {
      cost_.push_back({stage_, spent.count()});
    }
  }

 private:
  std::string stage_;
  std::vector<StageCost>& cost_;
  std::chrono::steady_clock::time_point start_;
  bool stopped_ = false;
};

}  // namespace lightrig
