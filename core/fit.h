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
  double outlier_sigma = 0;  ///< > 0: Huber weight on residuals beyond it
};

/// Coefficients of the basis with their uncertainty.
struct Coefficients {
  Eigen::MatrixXd c;                        ///< (k × 1) stacked solved jointly, else (k × C)
  std::vector<Eigen::MatrixXd> covariance;  ///< one (k × k) per column of c
  double residual_rms = 0;                  ///< mapped units, over value rows
  std::int64_t rows_value = 0, rows_censored = 0;
  int rank = 0;  ///< least over channels
};

/// Fits the observations of all lights together. Channels without any row keep the prior mean (map)
/// or zero, and say so by their covariance. With channels = 1 (mono) one column is fitted.
Coefficients fit(const BrdfBasis& basis, std::span<const BrdfObservations> lights, int channels,
                 const FitOptions& options);

/// The reconstructed BRDF with what is known of its error.
struct Reconstruction {
  BrdfTable brdf;
  Eigen::ArrayXXd log_stddev;          ///< (cells × C), standard deviation in mapped units
  double predicted_error_percent = 0;  ///< expected METHOD.md percentage error
  double predicted_low_percent = 0, predicted_high_percent = 0;  ///< 90 % interval
  int clipped_cells = 0;
};
Reconstruction reconstruct(const BrdfBasis& basis, const Coefficients& coefficients);

/// The predicted error before any measurement, from cells alone; used by the planner.
/// 100·√(trace)/‖E ln f‖.
double predicted_error_percent(const BrdfBasis& basis, std::span<const Eigen::MatrixXd> covariance,
                               const Eigen::MatrixXd& c);

}  // namespace lightrig
