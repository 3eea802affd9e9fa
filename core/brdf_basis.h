#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "core/brdf_table.h"
#include "core/result.h"

namespace lightrig {

/// How a BRDF value becomes the number that statistics are made of.
enum class Mapping : std::uint8_t {
  ln_floor,      ///< y = ln max(f, floor)
  ln_offset,     ///< y = ln(f + floor)
  log_relative,  ///< y = ln((f·w + floor)/(f_ref·w + floor)), w = cos θi cos θo weight, f_ref the
                 ///< median [Nielsen 2015]
};

/// The mapping with its numbers; the same for basis and observations, always recorded.
struct LogMapping {
  Mapping kind = Mapping::ln_floor;
  double floor = 1e-4;       ///< [1/sr]
  Eigen::ArrayXd weight;     ///< (cells), log_relative only
  Eigen::ArrayXd reference;  ///< (cells) [1/sr], log_relative only
};
double map_value(const LogMapping& mapping, int cell, double f);
double unmap_value(const LogMapping& mapping, int cell, double y);
/// dy/df at f, for carrying variances.
double map_slope(const LogMapping& mapping, int cell, double f);

enum class ChannelLayout : std::uint8_t {
  stacked,  ///< one training column per material, its channels stacked as rows: row = channel ·
            ///< cells + cell
  columns,  ///< one training column per material and channel: row = cell; every channel uses the
            ///< same basis
};

/// Where nine in ten of what remains lies, in ln units; 5 % fall below, 5 % above. Empty: unknown.
struct ErrorBand {
  double low = 0, high = 0;
};

/// From the error that a posterior expects to the error that unseen materials had, found by leaving
/// materials out: ln(true/expected) ≈ offset + slope · surprise + shift · censored, where surprise
/// = ½ ln(‖c/s‖²/its expectation) says how unlike the training set the fitted material is, and
/// censored is the share of rows known only to lie beyond a level. The band is of quantiles, not of
/// deviations: what remains is skewed, and wider where rows are censored.
struct ErrorCalibration {
  double slope = 0, offset = 0;
  double typical_surprise = 0;  ///< mean over held-out materials: stands in before any measurement
  double spread = 0.4;          ///< standard deviation of what remains without censoring, ln units
  ErrorBand exact;              ///< no row censored; where unknown, ±1.645 spread
  double censored_shift = 0;
  double censored_share = 0;  ///< [0, 1] mean of the fits that `censored` was found from; 0: none
  ErrorBand censored;         ///< at that share
};

/// Statistics of a set of materials: mean and principal components of the mapped values.
struct BrdfBasis {
  BivariateGrid grid;
  ChannelLayout layout = ChannelLayout::columns;
  int channels = 3;  ///< channels of the training data
  LogMapping mapping;
  std::vector<std::uint8_t> valid;  ///< (cells): 1 where every training material has a value
  Eigen::VectorXd mean;             ///< (rows); 0 in invalid cells
  Eigen::MatrixXd V;                ///< (rows × k), orthonormal columns; 0 in invalid cells
  /// (k), descending: standard deviations of the coefficients of unseen materials, by leaving
  /// materials out; without folds those of the training set, which are too small at the last
  /// components because these were made to fit.
  Eigen::VectorXd stddev;
  Eigen::VectorXd training_stddev;  ///< (k), descending: over the training set itself
  Eigen::VectorXd y_min, y_max;     ///< (rows): training range
  /// What exponents may lie outside a row's training range on either side, in such ranges: as much
  /// as unseen materials need it, by leaving materials out. 0 without folds: the bare range.
  double range_slack = 0;
  /// Standard deviation of a row in a fit besides its noise: what the basis cannot say of unseen
  /// materials, mapped units. The one of least error when materials are left out.
  double model_sigma = 0.15;
  /// Root mean square, over the grid, of what no coefficients can say of an unseen material.
  double unsaid_sigma = 0.15;
  ErrorCalibration calibration;
  /// The four above were found by leaving materials out. False where folds were asked for but the
  /// materials are too few: then unsaid_sigma is the training set's own scatter, the only thing
  /// known of how far a new material may lie from it.
  bool left_out = false;
  double variance_captured = 0;  ///< [0, 1] by the k components
  int materials = 0;
  std::string source;

  Eigen::Index rows() const { return V.rows(); }
  Eigen::Index components() const { return V.cols(); }
  Eigen::Index row(int cell, int channel) const {
    return layout == ChannelLayout::stacked ? Eigen::Index{channel} * grid.cells() + cell : cell;
  }
};

struct BasisOptions {
  ChannelLayout layout = ChannelLayout::columns;
  Mapping mapping = Mapping::ln_floor;
  double floor = 1e-4;  ///< [1/sr]
  int components = 0;   ///< 0: all that the data support (columns − 1)
  /// Hold-out folds (leave-materials-out) for stddev, model_sigma, unsaid_sigma and calibration; 0
  /// leaves the training deviations and the defaults. Folds are over
  /// families where all materials have one (else over materials), never over the channels of one:
  /// group i, in order of appearance, is in fold i mod sigma_folds.
  int sigma_folds = 5;
  /// 0: as many channels as the materials have; 1: the mean of their channels (a mono camera).
  int channels = 0;
  int threads = 1;  ///< for the folds; the result does not depend on it
};

/// PCA of the materials. Errors: invalid_input when the grids differ, fewer than 2 materials, or
/// more components asked for than columns − 1. Deterministic: signs fixed so that each column's
/// entry of largest magnitude is positive.
Result<BrdfBasis> make_basis(std::span<const Material> materials, const BasisOptions& options);

/// The first k components of a basis.
BrdfBasis truncated(const BrdfBasis& basis, Eigen::Index k);

/// mean + V c per channel, unmapped, exponents clipped to the training range widened by
/// range_slack; NaN in invalid cells.
/// Column basis: c is (k × C), C any number of channels. Stacked basis: c is (k × 1), one vector
/// for all channels solved jointly, or (k × channels), where channel j is its own block of rows
/// times column j (each channel solved by itself, as in the paper's tables). `clipped` counts the
/// cells × channels that were.
BrdfTable evaluate(const BrdfBasis& basis, const Eigen::MatrixXd& c, int* clipped = nullptr);

}  // namespace lightrig
