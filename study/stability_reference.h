#pragma once

#include <Eigen/Core>
#include <vector>

namespace lightrig {

/// References in a hundred decimal digits, computed from the doubles given and rounded once at the
/// end. They share no formula with core.
struct ReferenceRatio {
  double condition = 0;    ///< (σ₁/σ_k)²; infinite where σ_k is 0 to a hundred digits
  double least_ratio = 0;  ///< σ_k/σ₁
};
ReferenceRatio reference_condition(const Eigen::MatrixXd& G);

/// tr((diag(1/s²) + GᵀG/σ²)⁻¹), s > 0.
double reference_posterior_trace(const Eigen::VectorXd& s, const Eigen::MatrixXd& G, double sigma);

/// c of least Σ(ln max(f, floor) − mean − Gc)²/(noise/max(f, floor)² + sigma²) + Σ(c/s)²; s may be
/// infinite. Rows of G all hold; zero where there is no row.
Eigen::VectorXd reference_map(const Eigen::MatrixXd& G, const Eigen::VectorXd& f,
                              const Eigen::VectorXd& noise, double floor, double mean, double sigma,
                              const Eigen::VectorXd& s);

/// θh and θd of unit vectors (0, 0, 1), (sin a, 0, cos a), (sin b, 0, cos b), as the angles are
/// defined: acos(n·h) and acos(l·h) with h the normalised sum.
struct ReferenceAngles {
  double theta_h = 0, theta_d = 0;
};
ReferenceAngles reference_angles(const Eigen::Vector3d& n, const Eigen::Vector3d& l,
                                 const Eigen::Vector3d& v);

/// Deflection after t of q″ + 2ζω q′ + ω² q = −a from rest, ω = 2πf.
double reference_arm(double frequency, double damping, double acceleration, double t);

/// Inverse-variance mean of `value` with `variance`.
double reference_weighted_mean(const std::vector<double>& value,
                               const std::vector<double>& variance);

}  // namespace lightrig
