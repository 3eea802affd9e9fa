#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <limits>
#include <span>
#include <vector>

#include "core/brdf_basis.h"
#include "core/candidate_bins.h"
#include "core/planner.h"

namespace lightrig {

/// The rows of V that planning looks at, cell by cell: a cell is one row of a basis with channels
/// as columns, one per channel of a stacked one.
class CellRows {
 public:
  explicit CellRows(const BrdfBasis& basis) : basis_(basis) {}

  int per_cell() const { return basis_.layout == ChannelLayout::stacked ? basis_.channels : 1; }
  Eigen::Index components() const { return basis_.components(); }

  /// The rows of these cells, one under the other: (per_cell · cells × k).
  Eigen::MatrixXd gather(std::span<const std::int32_t> cells) const;

 private:
  const BrdfBasis& basis_;
};

/// The cells of `offered` that are not marked in `seen` (cells).
std::vector<std::int32_t> unseen(std::span<const std::int32_t> offered,
                                 const std::vector<std::uint8_t>& seen);

/// The cells marked in `seen` (cells), ascending.
std::vector<std::int32_t> marked(const std::vector<std::uint8_t>& seen);

/// What the numbers of a set of lights say: rank, and κ² or the criterion's own value.
struct Standing {
  int candidate = -1;  ///< −1: none
  int rank = 0;
  double score = std::numeric_limits<double>::infinity();
};

/// Singular values of G, descending; (min(rows, k)). By QR and one-sided rotations of R, so that
/// small ones keep their digits as far as the data have them.
Eigen::VectorXd singular_values(const Eigen::MatrixXd& G);

/// Rank and pseudo-condition σ₁²/σ_rank² from the singular values of a matrix of `rows` rows and k
/// columns; σ counts while above max(rows, k)·ε·σ₁.
Conditioning conditioning_of(const Eigen::VectorXd& singular, Eigen::Index rows, Eigen::Index k);

/// Trace of the posterior covariance of MAP after observing rows G with standard deviation sigma:
/// tr((diag(1/s²) + GᵀG/σ²)⁻¹). V is orthonormal, so this is the trace over the BRDF as well.
double posterior_trace(const Eigen::VectorXd& stddev, const Eigen::MatrixXd& G, double sigma);

/// The relative difference below which two scores of the condition criterion count as equal: 1e-9,
/// or what rounding leaves of a worse-conditioned one.
double tie_tolerance(double score);

/// The best of several: larger rank, then smaller score, then, among scores that tie with the
/// smallest, smaller index.
Standing best_of(std::span<const Standing> standings);

}  // namespace lightrig
