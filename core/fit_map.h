#pragma once

#include <Eigen/Core>
#include <vector>

#include "core/samples.h"

namespace lightrig {

/// Rows of one linear problem y ≈ G c in mapped units, the basis' mean taken off.
struct DesignRows {
  Eigen::MatrixXd G;                        ///< (rows × k)
  std::vector<double> y;                    ///< (rows); of a censored row, its bound
  std::vector<double> noise_variance;       ///< (rows) of the measurement, mapped units squared
  std::vector<BrdfObservation::Kind> kind;  ///< (rows)
};

/// What a fit knows of c.
struct Posterior {
  Eigen::VectorXd c;           ///< (k)
  Eigen::MatrixXd covariance;  ///< (k × k)
  std::vector<double> weight;  ///< (rows) 1, or what Huber's rule left of a value row
  int rank = 0;
  int iterations = 1;
};

/// Maximum of the posterior of c with prior N(0, diag(stddev²)): value rows by a Gaussian of
/// variance noise + sigma², rows `above`/`below` by its distribution function beyond the bound.
/// outlier_sigma > 0 gives value rows Huber's loss beyond that many standard deviations. The
/// objective is convex: damped Newton steps, each a weighted least-squares problem, find its only
/// minimum. The covariance is the inverse Hessian there.
Posterior fit_map(const DesignRows& rows, const Eigen::VectorXd& stddev, double sigma,
                  double outlier_sigma);

/// ln Φ(t) and the first two derivatives' parts of a standard normal, without cancellation in
/// either tail: slope λ = φ(t)/Φ(t), and excess λ + t > 0.
struct LogNormalCdf {
  double value = 0;   ///< ln Φ(t)
  double slope = 0;   ///< λ(t)
  double excess = 0;  ///< λ(t) + t
};
LogNormalCdf log_normal_cdf(double t);

}  // namespace lightrig
