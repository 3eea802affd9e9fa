#pragma once

#include <cstdint>
#include <limits>
#include <memory>
#include <span>
#include <vector>

#include "core/brdf_basis.h"
#include "core/candidate_bins.h"

namespace lightrig {

class LightChooser;

enum class Criterion : std::uint8_t {
  condition,  ///< κ² = λmax/λmin of GᵀG [Ali 2013]
  a_optimal,  ///< posterior trace over the BRDF, with the prior of the basis
};
enum class StopRule : std::uint8_t {
  literal,  ///< until the criterion no longer falls
  plateau,  ///< until it falls by less than `plateau`
  count,    ///< exactly max_lights, if so many help at all
};

struct SelectionOptions {
  Criterion criterion = Criterion::condition;
  StopRule stop = StopRule::plateau;
  double plateau =
      0.2;  ///< [0, 1]: relative fall below which a further light is not worth its time
  int max_lights = 40;
  double sigma = 0.15;       ///< a-optimal: standard deviation of an observed row, mapped units
  std::vector<int> already;  ///< candidates captured already: their rows stand from the start
  /// Rows measured already, (r × components) or empty: rows of V, each times √w, where w is what it
  /// is worth of a row that the plan counts on, σ²/(σ² + its own variance). They stand from the
  /// start. Candidates that show their cells would count these again: leave them out of the bins.
  Eigen::MatrixXd had;
  std::vector<std::uint8_t> excluded;  ///< (candidates) or empty: 1 = may not be chosen
  bool brute_force = false;            ///< no shortcut at all: the plain reference
  int threads = 1;
};

struct SelectedLight {
  int candidate = -1;
  /// λmax/λmin of GᵀG with all lights so far; infinite while rank < components. Reported under
  /// either criterion.
  double condition = std::numeric_limits<double>::infinity();
  int rank = 0;
  double score = 0;  ///< the criterion's own value after this light
  int new_cells = 0;
  double predicted_error_percent = 0;  ///< percentage error expected of MAP with all lights so far:
                                       ///< fit.h's predicted_error_percent at the mean material
};

/// What the selection left out, and did.
struct SelectionStatistics {
  std::int64_t identical_candidates = 0;  ///< merged with one that has the same new cells
  std::int64_t exact_evaluations = 0;     ///< eigen- or singular-value solves, or exact traces
  std::int64_t bounded_away = 0;          ///< discarded by a bound alone
  std::int64_t empty_candidates = 0;      ///< see nothing
};

struct Selection {
  std::vector<SelectedLight> lights;  ///< in order of selection, without `already`
  SelectionStatistics statistics;
  bool plateau_reached = false;
  double mean_only_error_percent = 0;  ///< predicted error with no light at all
};

/// Greedy choice of lights. Ordering: larger rank (condition only: MAP is always of full rank),
/// then smaller score, then smaller index; scores within 1e-9 relative of the smallest are ties,
/// or, from κ² ≈ 1e11 on, within what rounding leaves of it (16 ε κ). Exact: the same lights with
/// and without brute_force. A candidate that adds no cell is never chosen. Scores: κ², or
/// σ₁²/σ_rank² while the rank is short of the components; the trace of the posterior covariance of
/// one set of coefficients, which is the trace over the BRDF since V is orthonormal.
Selection select_lights(const BrdfBasis& basis, const CandidateBins& bins,
                        const SelectionOptions& options);

/// select_lights() in two parts: the candidates made ready once, then chosen from as often as there
/// is a reason to, a light lost or rows that were saturated. With the lights captured so far in
/// `already` and those lost in `excluded` the next choice costs one step, not a plan. Not for two
/// threads at once.
class LightPlanner {
 public:
  /// `basis` and `bins` must outlive it. Of the options the criterion, sigma, brute_force and
  /// threads count here and hold for every selection.
  LightPlanner(const BrdfBasis& basis, const CandidateBins& bins, const SelectionOptions& options);
  ~LightPlanner();
  LightPlanner(LightPlanner&&) noexcept;

  /// The rest of the options may differ from call to call. The same lights as select_lights().
  Selection select(const SelectionOptions& options);

  /// What `had` and `already` come to together, with no light chosen; candidate −1.
  SelectedLight judge(const SelectionOptions& options);

 private:
  void begin(const SelectionOptions& options);

  const BrdfBasis& basis_;
  const CandidateBins& bins_;
  std::unique_ptr<LightChooser> chooser_;
  bool used_ = false;
};

/// κ² of the given candidates' rows together; infinite and rank when rank-deficient.
struct Conditioning {
  double condition = std::numeric_limits<double>::infinity();
  double pseudo_condition = 1;  ///< σ₁²/σ_rank²
  int rank = 0;
};
Conditioning conditioning(const BrdfBasis& basis, const CandidateBins& bins,
                          std::span<const int> candidates);

}  // namespace lightrig
