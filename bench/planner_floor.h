#pragma once

#include "core/planner.h"

namespace lightrig::bench {

/// What one thread of this machine does, the best of what was measured so far.
struct Machine {
  double bandwidth = 0;  ///< [B/s] reading memory
  double flops = 0;      ///< [1/s] multiply-adds of independent registers, each counted as two

  /// Measures again.
  void measure();
};

/// [s] what a plan takes at the least, under two readings of "at the least".
struct Floors {
  double greedy = 0;  ///< a greedy that scores every distinct candidate once per light
  double oracle = 0;  ///< one that knows the winners beforehand
};

/// Prints both with their formulas. `lit` is the number of pairs of a candidate and a point that
/// faces the camera and that candidate, `points` that of points that face the camera.
Floors print_floors(const BrdfBasis& basis, const CandidateBins& bins, const Selection& plan,
                    double points, double lit, const Machine& machine);

}  // namespace lightrig::bench
