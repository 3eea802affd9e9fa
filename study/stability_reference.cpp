#include "study/stability_reference.h"

#include <boost/multiprecision/cpp_bin_float.hpp>
#include <cmath>
#include <limits>

namespace lightrig {

namespace {

using Real = boost::multiprecision::number<boost::multiprecision::cpp_bin_float<100>,
                                           boost::multiprecision::et_off>;
using Columns = std::vector<std::vector<Real>>;

Real dot(const std::vector<Real>& a, const std::vector<Real>& b) {
  Real sum = 0;
  for (std::size_t i = 0; i < a.size(); ++i) sum += a[i] * b[i];
  return sum;
}

/// Eigenvalues of a symmetric matrix by classical two-sided Jacobi rotations.
std::vector<Real> eigenvalues(Columns A) {
  const std::size_t n = A.size();
  for (int sweep = 0; sweep < 60; ++sweep) {
    Real off = 0, diagonal = 0;
    for (std::size_t i = 0; i < n; ++i) {
      diagonal += A[i][i] * A[i][i];
      for (std::size_t j = 0; j < i; ++j) off += A[i][j] * A[i][j];
    }
    if (off <= diagonal * Real("1e-190")) break;
    for (std::size_t p = 0; p + 1 < n; ++p) {
      for (std::size_t q = p + 1; q < n; ++q) {
        if (A[p][q] == 0) continue;
        const Real theta = (A[q][q] - A[p][p]) / (2 * A[p][q]);
        const Real root = sqrt(theta * theta + 1);
        const Real t = theta >= 0 ? Real(1 / (theta + root)) : Real(-1 / (root - theta));
        const Real c = 1 / sqrt(t * t + 1), s = t * c;
        for (std::size_t k = 0; k < n; ++k) {
          const Real x = A[k][p], y = A[k][q];
          A[k][p] = c * x - s * y;
          A[k][q] = s * x + c * y;
        }
        for (std::size_t k = 0; k < n; ++k) {
          const Real x = A[p][k], y = A[q][k];
          A[p][k] = c * x - s * y;
          A[q][k] = s * x + c * y;
        }
      }
    }
  }
  std::vector<Real> values;
  for (std::size_t i = 0; i < n; ++i) values.push_back(A[i][i]);
  return values;
}

/// GᵀG; a hundred digits leave sixty after squaring what doubles can tell apart.
Columns gram(const Eigen::MatrixXd& G) {
  const auto k = static_cast<std::size_t>(G.cols());
  Columns columns(k);
  for (std::size_t j = 0; j < k; ++j) {
    for (Eigen::Index i = 0; i < G.rows(); ++i) {
      columns[j].emplace_back(G(i, static_cast<Eigen::Index>(j)));
    }
  }
  Columns A(k, std::vector<Real>(k));
  for (std::size_t i = 0; i < k; ++i) {
    for (std::size_t j = 0; j < k; ++j) A[i][j] = dot(columns[i], columns[j]);
  }
  return A;
}

}  // namespace

ReferenceRatio reference_condition(const Eigen::MatrixXd& G) {
  const std::vector<Real> values = eigenvalues(gram(G));
  Real least = values[0], greatest = values[0];
  for (const Real& v : values) {
    least = v < least ? v : least;
    greatest = v > greatest ? v : greatest;
  }
  if (least <= greatest * Real("1e-80")) return {std::numeric_limits<double>::infinity(), 0};
  return {static_cast<double>(Real(greatest / least)),
          static_cast<double>(Real(sqrt(least / greatest)))};
}

double reference_posterior_trace(const Eigen::VectorXd& s, const Eigen::MatrixXd& G, double sigma) {
  Columns A = gram(G);
  const std::size_t n = A.size();
  const Real variance = Real(sigma) * Real(sigma);
  for (std::size_t i = 0; i < n; ++i) {
    for (std::size_t j = 0; j < n; ++j) A[i][j] /= variance;
    const Real prior = Real(s[static_cast<Eigen::Index>(i)]);
    A[i][i] += 1 / (prior * prior);
  }
  // Trace of the inverse by Gauss–Jordan elimination; a positive definite matrix needs no pivots.
  Columns inverse(n, std::vector<Real>(n, Real(0)));
  for (std::size_t i = 0; i < n; ++i) inverse[i][i] = 1;
  for (std::size_t p = 0; p < n; ++p) {
    const Real pivot = A[p][p];
    for (std::size_t j = 0; j < n; ++j) {
      A[p][j] /= pivot;
      inverse[p][j] /= pivot;
    }
    for (std::size_t i = 0; i < n; ++i) {
      if (i == p) continue;
      const Real factor = A[i][p];
      for (std::size_t j = 0; j < n; ++j) {
        A[i][j] -= factor * A[p][j];
        inverse[i][j] -= factor * inverse[p][j];
      }
    }
  }
  Real trace = 0;
  for (std::size_t i = 0; i < n; ++i) trace += inverse[i][i];
  return static_cast<double>(trace);
}

Eigen::VectorXd reference_map(const Eigen::MatrixXd& G, const Eigen::VectorXd& f,
                              const Eigen::VectorXd& noise, double floor, double mean, double sigma,
                              const Eigen::VectorXd& s) {
  const Eigen::Index k = G.cols();
  if (G.rows() == 0) return Eigen::VectorXd::Zero(k);
  const auto n = static_cast<std::size_t>(k);
  Columns A(n, std::vector<Real>(n + 1, Real(0)));  // the last column is the right-hand side
  for (Eigen::Index r = 0; r < G.rows(); ++r) {
    const Real value = f[r] > floor ? Real(f[r]) : Real(floor);
    const Real weight = 1 / (Real(noise[r]) / (value * value) + Real(sigma) * Real(sigma));
    const Real y = log(value) - Real(mean);
    for (std::size_t i = 0; i < n; ++i) {
      const Real g = weight * Real(G(r, static_cast<Eigen::Index>(i)));
      for (std::size_t j = 0; j < n; ++j) A[i][j] += g * Real(G(r, static_cast<Eigen::Index>(j)));
      A[i][n] += g * y;
    }
  }
  for (std::size_t i = 0; i < n; ++i) {
    const double prior = s[static_cast<Eigen::Index>(i)];
    if (std::isfinite(prior)) A[i][i] += 1 / (Real(prior) * Real(prior));
  }
  // Gauss–Jordan elimination; a positive definite matrix needs no pivots.
  for (std::size_t p = 0; p < n; ++p) {
    for (std::size_t i = 0; i < n; ++i) {
      if (i == p) continue;
      const Real factor = A[i][p] / A[p][p];
      for (std::size_t j = p; j <= n; ++j) A[i][j] -= factor * A[p][j];
    }
  }
  Eigen::VectorXd c(k);
  for (std::size_t i = 0; i < n; ++i)
    c[static_cast<Eigen::Index>(i)] = static_cast<double>(Real(A[i][n] / A[i][i]));
  return c;
}

ReferenceAngles reference_angles(const Eigen::Vector3d& n, const Eigen::Vector3d& l,
                                 const Eigen::Vector3d& v) {
  const auto unit = [](std::vector<Real> a) {
    const Real length = sqrt(dot(a, a));
    for (Real& x : a) x /= length;
    return a;
  };
  const auto exact = [&](const Eigen::Vector3d& a) {
    return unit({Real(a.x()), Real(a.y()), Real(a.z())});
  };
  const std::vector<Real> en = exact(n), el = exact(l), ev = exact(v);
  const std::vector<Real> h = unit({el[0] + ev[0], el[1] + ev[1], el[2] + ev[2]});
  return {static_cast<double>(Real(acos(dot(en, h)))), static_cast<double>(Real(acos(dot(el, h))))};
}

double reference_arm(double frequency, double damping, double acceleration, double t) {
  const Real pi = boost::math::constants::pi<Real>();
  const Real w = 2 * pi * Real(frequency), z = Real(damping), time = Real(t);
  const Real rest = -Real(acceleration) / (w * w);
  if (damping < 1) {
    const Real wd = w * sqrt(1 - z * z);
    return static_cast<double>(
        Real(rest * (1 - exp(-z * w * time) * (cos(wd * time) + z * w / wd * sin(wd * time)))));
  }
  const Real root = sqrt(z * z - 1), a = w * (z - root), b = w * (z + root);
  return static_cast<double>(
      Real(rest * (1 - (b * exp(-a * time) - a * exp(-b * time)) / (b - a))));
}

double reference_weighted_mean(const std::vector<double>& value,
                               const std::vector<double>& variance) {
  Real sum = 0, weight = 0;
  for (std::size_t i = 0; i < value.size(); ++i) {
    sum += Real(value[i]) / Real(variance[i]);
    weight += 1 / Real(variance[i]);
  }
  return static_cast<double>(Real(sum / weight));
}

}  // namespace lightrig
