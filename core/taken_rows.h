#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <span>
#include <vector>

#include "core/planner_kernels.h"

namespace lightrig {

/// The rows of the lights taken: their Gram matrix at once, their QR factor once it is asked for.
/// While the rows are well conditioned, the Gram matrix alone decides, and lights that stand from
/// the start cost no factor.
class TakenRows {
 public:
  /// `rows` must outlive it.
  TakenRows(const PackedRows& rows, int level);

  /// Measured already: (r × k).
  void stand_on(const Eigen::MatrixXd& had);
  void take(std::span<const std::int32_t> cells);
  /// The same where the factor of all rows with these is known.
  void take(std::span<const std::int32_t> cells, PackedRows R);
  void clear();

  Eigen::Index count() const { return count_; }

  /// Gram matrix, upper triangle (k × stride).
  std::span<const double> gram() const { return gram_; }

  /// The factor brought up to date; one row per "cell", empty where there is none.
  const PackedRows& factor();
  bool factored() const { return behind_.empty() && !had_behind_; }

  /// At least |Gx|² and at most |Gy|² of unit vectors (stride), each as near as rounding lets it
  /// be; by the factor where that is up to date.
  struct Energies {
    double of_x = 0, of_y = 0;
  };
  Energies energies(std::span<const double> x, std::span<const double> y) const;

 private:
  const PackedRows& rows_;
  int level_;
  std::vector<double> gram_;
  PackedRows R_, next_, had_;
  std::vector<std::int32_t> behind_;  ///< cells that R_ lacks
  bool had_behind_ = false;           ///< R_ lacks had_
  Eigen::Index count_ = 0;
  std::vector<double> scratch_;
};

}  // namespace lightrig
