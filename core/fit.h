#pragma once

#include <Eigen/Core>
#include <span>
#include <vector>

#include "core/brdf_basis.h"
#include "core/samples.h"

namespace lightrig {

enum class Estimator : std::uint8_t {
  pseudo_inverse,  ///< c = G⁺(b − m) by QR [Ali 2013, eq. 3]; minimum norm where rank-deficient
  map,             ///< min ‖(y − Gc)/σ‖² + ‖c/s‖², censored rows by their likelihood
};

struct FitOptions {
  Estimator estimator = Estimator::map;
  double model_sigma = 0;  ///< mapped units; 0 takes the basis'
  bool use_censored = true;
  double outlier_sigma = 0;  ///< > 0: Huber weight on residuals beyond it (map)
  bool find_rank = true;     ///< false leaves Coefficients::rank of MAP 0 and saves its QR
};

/// Coefficients of the basis with their uncertainty.
///
/// Column basis: c is (k × C), each channel fitted by itself. Stacked basis: MAP solves all
/// channels jointly, c is (k × 1); the pseudo-inverse solves each channel by itself with its own
/// block of rows, as the paper's tables do, and c is (k × C). evaluate() and reconstruct() take
/// either.
struct Coefficients {
  Eigen::MatrixXd c;                        ///< (k × 1) stacked solved jointly, else (k × C)
  std::vector<Eigen::MatrixXd> covariance;  ///< one (k × k) per column of c
  double residual_rms = 0;                  ///< mapped units, over value rows
  std::int64_t rows_value = 0, rows_censored = 0;
  int rank = 0;  ///< least over channels
};

/// Fits the observations of all lights together. Rows of one cell and channel seen under several
/// lights become one. A row's variance is its measured noise, carried through the mapping, plus
/// model_sigma². Channels without any row keep the prior mean and the prior's covariance. With
/// channels = 1 (mono) one column is fitted; a stacked basis must have as many channels.
Coefficients fit(const BrdfBasis& basis, std::span<const BrdfObservations> lights, int channels,
                 const FitOptions& options);

/// The reconstructed BRDF with what is known of its error.
struct Reconstruction {
  BrdfTable brdf;
  Eigen::ArrayXXd log_stddev;          ///< (cells × C), standard deviation of ln f
  double predicted_error_percent = 0;  ///< expected percentage error [docs/method.md]
  double predicted_low_percent = 0, predicted_high_percent = 0;  ///< 90 % interval
  int clipped_cells = 0;
};
Reconstruction reconstruct(const BrdfBasis& basis, const Coefficients& coefficients);

/// d ln f/dy of the mapping at f, ln f held at the floor below it: what a deviation in mapped units
/// is multiplied by to be one of ln f. 1 for a plain logarithm.
double ln_slope(const LogMapping& mapping, int cell, double f);

/// The percentage error expected of an estimate with this posterior; needs no measurement, so the
/// planner uses it with c = 0. 100·√(E‖ln f̂ − ln f‖² / E‖ln f‖²): the numerator is the trace of the
/// posterior over the grid and channels plus what the basis cannot say (unsaid_sigma²), times the
/// basis' calibration; the denominator ‖ln f̂‖² plus the same. One covariance per column of c.
double predicted_error_percent(const BrdfBasis& basis, std::span<const Eigen::MatrixXd> covariance,
                               const Eigen::MatrixXd& c);

/// What the calibration looks at, summed over the columns of c where it is a sum.
struct PosteriorSize {
  Eigen::Index columns = 1;
  double trace = 0;     ///< of the covariance
  double freedom = 0;   ///< k − tr(Σ S⁻²): coefficients that the rows determined
  double z2 = 0;        ///< ‖c/s‖²; 0 before any measurement
  double censored = 0;  ///< [0, 1] share of the rows that are bounds
};
PosteriorSize posterior_size(const BrdfBasis& basis, std::span<const Eigen::MatrixXd> covariance,
                             const Eigen::MatrixXd& c);
PosteriorSize posterior_size(const BrdfBasis& basis, const Coefficients& fitted);

/// Factor from the error that a posterior expects to the error that unseen materials had under like
/// posteriors [ErrorCalibration]; 1 before any row is known.
double calibration_factor(const BrdfBasis& basis, const PosteriorSize& size);

/// Factors from a predicted error to the ends of its 90 % interval.
struct ErrorInterval {
  double low = 1, high = 1;
};
ErrorInterval error_interval(const BrdfBasis& basis, const PosteriorSize& size);

/// predicted_error_percent() of a plain logarithm from the sizes alone; ln2 = ‖ln f̂‖² over the
/// valid grid and `channels`. Where V covers one channel (columns) or all (stacked).
double predicted_error_percent(const BrdfBasis& basis, const PosteriorSize& size, double ln2,
                               Eigen::Index channels);

}  // namespace lightrig
