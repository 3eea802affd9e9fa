#pragma once

#include <span>
#include <vector>

namespace lightrig {

/// Unit vectors towards the least and the greatest eigenvector of a symmetric matrix; (stride),
/// zeros at the end. Any pair bounds: λmin ≤ xᵀAx and λmax ≥ yᵀAy.
struct ExtremePair {
  std::vector<double> x, y;
};

/// Memory that one worker uses again for every matrix of k × stride numbers, upper triangles.
struct PairWork {
  PairWork(int k, int stride);
  std::vector<double> A;  ///< the matrix looked at
  std::vector<double> R;  ///< its Cholesky factor
  std::vector<double> z;  ///< (stride)
};

/// A pair with a part in every direction.
ExtremePair any_pair(int k, int stride);

/// Makes x a unit vector and returns how long it was; 0 where it has no direction. Numbers of any
/// size are welcome: their squares may leave the range.
double normalize(std::span<double> x);

/// y towards the greatest eigenvector of work.A by plain iteration; about its eigenvalue.
double refine_greatest(std::vector<double>& y, int k, int stride, int iterations, PairWork& work,
                       int level);

/// x towards the least eigenvector of work.A by inverse iteration; false where Cholesky is not fit
/// for it. `top` is about the greatest eigenvalue.
bool refine_least(std::vector<double>& x, double top, int k, int stride, int iterations,
                  PairWork& work, int level);

/// The same by the triangular factor of the matrix's rows (k × stride): for what Cholesky cannot
/// factor.
void refine_least_by_factor(std::vector<double>& x, std::span<const double> R, int k, int stride,
                            PairWork& work, int level);

/// Lower bound of κ² = λmax/λmin from an upper bound of λmin and a lower one of λmax of a matrix of
/// k components, both sums of squares, with room for their rounding.
double condition_bound(double low, double high, int k);

}  // namespace lightrig
