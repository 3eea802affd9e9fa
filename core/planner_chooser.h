#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "core/planner_rows.h"

namespace lightrig {

/// A criterion at work: finds the best next light, and takes it. One per selection; each keeps what
/// it needs of the lights taken so far.
class LightChooser {
 public:
  virtual ~LightChooser() = default;
  LightChooser() = default;
  LightChooser(const LightChooser&) = delete;
  LightChooser& operator=(const LightChooser&) = delete;

  /// The best of the candidates marked in `open` (candidates), or none where no open one adds a
  /// cell.
  virtual Standing best(const std::vector<std::uint8_t>& open) = 0;

  /// Adds rows of V measured already, (r × components), each times the root of its weight; before
  /// anything is taken.
  virtual void stand_on(const Eigen::MatrixXd& rows) = 0;

  /// Adds the cells of these candidates to those seen.
  virtual void take(std::span<const int> candidates) = 0;

  /// How the lights taken stand together; candidate −1, rank 0 where none shows a cell.
  virtual Standing standing() = 0;

  /// MAP's information of the rows taken, I + WᵀW with W = G diag(s)/σ; (k × k), of which the lower
  /// triangle counts.
  virtual Eigen::MatrixXd information() const = 0;

  /// Forgets what was taken and counted, and keeps what was prepared.
  virtual void restart() = 0;

  /// Cells seen so far (cells), 1 = seen.
  virtual const std::vector<std::uint8_t>& seen() const = 0;

  virtual const SelectionStatistics& statistics() const = 0;
};

/// Every candidate, every row, from scratch, on one thread: the plain reference of either
/// criterion.
std::unique_ptr<LightChooser> make_plain_chooser(const BrdfBasis& basis, const CandidateBins& bins,
                                                 const SelectionOptions& options);

/// The same choices by bounds: exact values only for the candidates that bounds cannot tell apart.
std::unique_ptr<LightChooser> make_condition_chooser(const BrdfBasis& basis,
                                                     const CandidateBins& bins,
                                                     const SelectionOptions& options);
std::unique_ptr<LightChooser> make_a_optimal_chooser(const BrdfBasis& basis,
                                                     const CandidateBins& bins,
                                                     const SelectionOptions& options);

}  // namespace lightrig
