#pragma once

#include <Eigen/Core>
#include <vector>

#include "core/samples.h"

namespace lightrig {

/// The problem of fit_map() seen from its rows: y = f + e with f ~ N(0, B), B = G S² Gᵀ. Worth it
/// where few rows meet many components, and many materials share one B.
struct RowProblem {
  Eigen::MatrixXd B;   ///< (rows × rows) prior covariance of the rows, mapped units squared
  Eigen::MatrixXd B2;  ///< (rows × rows) G S⁴ Gᵀ, for the posterior's trace
};
RowProblem row_problem(const Eigen::MatrixXd& GS, const Eigen::VectorXd& stddev);

/// Maximum of the posterior: coefficients are c = S² Gᵀ a.
struct RowPosterior {
  Eigen::VectorXd a;      ///< (rows)
  double told = 0;        ///< tr S² − trace of the posterior covariance
  double freedom = 0;     ///< k − tr(Σ S⁻²): coefficients that the rows determined
  bool converged = true;  ///< false: 100 damped steps were not enough
};

/// Value rows by a Gaussian of variance sigma², rows `above`/`below` by its distribution function
/// beyond the bound y [fit_map]. Every row counts `times` over: it stands for that many alike.
RowPosterior fit_rows(const RowProblem& problem, const Eigen::VectorXd& y,
                      const std::vector<BrdfObservation::Kind>& kind, double sigma, double times);

}  // namespace lightrig
