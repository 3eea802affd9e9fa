#include "core/censored_rows.h"

#include <Eigen/Cholesky>
#include <cmath>

#include "core/check.h"
#include "core/fit_map.h"

namespace lightrig {
namespace {

using Kind = BrdfObservation::Kind;

/// Working weights and responses at f, and the loss there.
struct Working {
  Eigen::VectorXd root_weight;  ///< (rows) square root of the curvature
  Eigen::VectorXd push;         ///< (rows) curvature · f − slope
  double loss = 0;
};

Working working_at(const Eigen::VectorXd& f, const Eigen::VectorXd& y,
                   const std::vector<Kind>& kind, double sigma, double times) {
  Working w{Eigen::VectorXd(f.size()), Eigen::VectorXd(f.size()), 0};
  for (Eigen::Index i = 0; i < f.size(); ++i) {
    const Kind one = kind[static_cast<std::size_t>(i)];
    const double t = (f[i] - y[i]) / sigma;
    if (one == Kind::value) {
      w.root_weight[i] = std::sqrt(times) / sigma;
      w.push[i] = times * y[i] / (sigma * sigma);
      w.loss += times * t * t / 2;
      continue;
    }
    const double sign = one == Kind::above ? 1 : -1;
    const LogNormalCdf cdf = log_normal_cdf(sign * t);
    const double curvature = times * cdf.slope * cdf.excess / (sigma * sigma);
    w.root_weight[i] = std::sqrt(std::max(curvature, 0.0));
    w.push[i] = curvature * f[i] + sign * times * cdf.slope / sigma;
    w.loss -= times * cdf.value;
  }
  return w;
}

/// I + W^½ B W^½: no eigenvalue below 1.
Eigen::LLT<Eigen::MatrixXd> factored(const Eigen::MatrixXd& B, const Eigen::VectorXd& root_weight) {
  Eigen::MatrixXd inner = root_weight.asDiagonal() * B * root_weight.asDiagonal();
  inner.diagonal().array() += 1;
  Eigen::LLT<Eigen::MatrixXd> llt(inner);
  CHECK(llt.info() == Eigen::Success);
  return llt;
}

}  // namespace

RowProblem row_problem(const Eigen::MatrixXd& GS, const Eigen::VectorXd& stddev) {
  CHECK(GS.cols() == stddev.size());
  const Eigen::MatrixXd GS2 = GS * stddev.asDiagonal();
  return {GS * GS.transpose(), GS2 * GS2.transpose()};
}

RowPosterior fit_rows(const RowProblem& problem, const Eigen::VectorXd& y,
                      const std::vector<Kind>& kind, double sigma, double times) {
  CHECK(sigma > 0 && times > 0 && kind.size() == static_cast<std::size_t>(y.size()));
  constexpr int most_steps = 100;
  RowPosterior out;
  out.a = Eigen::VectorXd::Zero(y.size());
  Eigen::VectorXd f = Eigen::VectorXd::Zero(y.size());
  Working w = working_at(f, y, kind, sigma, times);
  double objective = w.loss;
  for (int step = 0;; ++step) {
    const Eigen::LLT<Eigen::MatrixXd> llt = factored(problem.B, w.root_weight);
    // a = push − W^½ (I + W^½BW^½)⁻¹ W^½ B push [Rasmussen & Williams 2006, alg. 3.1].
    const Eigen::VectorXd inner = w.root_weight.cwiseProduct(problem.B * w.push);
    const Eigen::VectorXd goal = w.push - w.root_weight.cwiseProduct(llt.solve(inner));
    const Eigen::VectorXd towards = goal - out.a;
    double moved = 0, length = 1;
    for (int halving = 0; halving < 30; ++halving, length /= 2) {
      const Eigen::VectorXd a = out.a + length * towards;
      const Eigen::VectorXd at = problem.B * a;
      const Working next = working_at(at, y, kind, sigma, times);
      const double value = next.loss + a.dot(at) / 2;
      if (!(value <= objective + 1e-12 * std::abs(objective))) continue;
      moved = (at - f).cwiseAbs().maxCoeff();
      out.a = a;
      f = at;
      w = next;
      objective = value;
      break;
    }
    if (moved <= 1e-7 * sigma || step == most_steps) {
      out.converged = moved <= 1e-7 * sigma;
      break;
    }
  }
  const Eigen::LLT<Eigen::MatrixXd> llt = factored(problem.B, w.root_weight);
  const Eigen::Index n = y.size();
  const Eigen::MatrixXd inverse = llt.solve(Eigen::MatrixXd::Identity(n, n));
  out.freedom = static_cast<double>(n) - inverse.trace();
  const Eigen::MatrixXd weighted =
      w.root_weight.asDiagonal() * problem.B2 * w.root_weight.asDiagonal();
  out.told = inverse.cwiseProduct(weighted).sum();
  return out;
}

}  // namespace lightrig
