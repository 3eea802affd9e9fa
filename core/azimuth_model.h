#pragma once

#include <Eigen/Core>
#include <span>
#include <utility>
#include <vector>

#include "core/brdf_basis.h"
#include "core/brdf_table.h"

namespace lightrig {

/// What a bivariate table averages away, in one number: how far along its range φd is, 0 where a
/// direction touches the horizon (or φd = 0), 1 at φd = π/2. Folded about π/2, where swapping light
/// and camera mirrors it.
double azimuth_share(const HalfDiff& angles);

/// ln f at each of `azimuth_bins` equal parts of azimuth_share() less ln of the mean over φd, per
/// cell: row cell · azimuth_bins + bin, one column per channel. Of values at shares (k +
/// ½)/per_cell (cells · per_cell × C), per_cell a multiple of the bins; of a MERL file, empty where
/// it has fewer than two φd per bin. 0 where there is no value.
inline constexpr int azimuth_bins = 4;
Eigen::ArrayXXf azimuth_departures(const Eigen::ArrayXXd& each, int cells);
Eigen::ArrayXXf azimuth_departures(const MerlTable& table);

/// How ln f at one φd departs from ln of its mean over φd, as the training materials show it: a
/// light shows a cell at a few φd only, the table holds the mean over all. The departure is linear
/// in a material's coefficients, d = m + D Cᵀ(C Cᵀ + τ)⁻¹ c with C the training coefficients and D
/// their departures; τ leaves out components too faint to be told in a cell. No departure is known
/// (none()) of bivariate materials, and of a stacked basis.
class AzimuthModel {
 public:
  AzimuthModel() = default;
  /// Materials as the basis was made of; those without `azimuth` yield none().
  AzimuthModel(std::span<const Material> materials, const BrdfBasis& basis);

  bool none() const { return !known_; }

  /// Weights of the training columns (n × C) that stand for coefficients (k × C).
  Eigen::MatrixXf weights(const Eigen::MatrixXd& c) const;

  /// ln f − ln of the mean over φd at a cell and azimuth_share(), per column of `weights`; kept
  /// within the range of the training materials.
  Eigen::VectorXf departure(int cell, double share, const Eigen::MatrixXf& weights) const;

  /// Variance of what departure() leaves unsaid, of (cell, share) each: mean square over the
  /// training columns of the residual when that column is left out of the regression.
  std::vector<double> variance(std::span<const std::pair<int, double>> places) const;

 private:
  Eigen::Index column(int cell, double share) const;

  bool known_ = false;
  Eigen::MatrixXf departures_;  ///< (n × cells · bins), mean taken off
  Eigen::VectorXf mean_;        ///< (cells · bins)
  Eigen::MatrixXd regression_;  ///< (n × k) Cᵀ(C Cᵀ + τ)⁻¹
  Eigen::MatrixXf unsaid_;      ///< (cells · bins × 1) variance of what the regression leaves
};

}  // namespace lightrig
