#include "core/brdf_error.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include "core/check.h"

namespace lightrig {

BrdfError brdf_error(const BrdfTable& estimate, const BrdfTable& truth, double floor) {
  CHECK(estimate.grid == truth.grid);
  CHECK(estimate.f.cols() == truth.f.cols());
  CHECK(floor > 0);
  BrdfError error;
  std::vector<double> abs_log;
  abs_log.reserve(static_cast<std::size_t>(truth.f.size()));
  double log_difference = 0, log_truth = 0, cos_difference = 0, cos_truth = 0;
  for (int cell = 0; cell < truth.grid.cells(); ++cell) {
    // cos θi cos θo at the cell's centre, where φd = π/2 and both are cos θh cos θd.
    const HalfDiff centre = cell_centre(truth.grid, cell);
    const double both = std::cos(centre.theta_h) * std::cos(centre.theta_d);
    const double weight = both * both;
    for (Eigen::Index channel = 0; channel < truth.f.cols(); ++channel) {
      const double f_hat = estimate.f(cell, channel), f = truth.f(cell, channel);
      if (!std::isfinite(f_hat) || !std::isfinite(f)) continue;
      const double ln_f = std::log(std::max(f, floor));
      const double d = std::log(std::max(f_hat, floor)) - ln_f;
      log_difference += d * d;
      log_truth += ln_f * ln_f;
      abs_log.push_back(std::abs(d));
      const double linear = (f_hat - f) * weight;
      cos_difference += linear * linear;
      cos_truth += f * weight * f * weight;
    }
  }
  error.cells = static_cast<int>(abs_log.size());
  if (abs_log.empty()) return error;
  // A truth of zero norm has no percentage; any difference from it is then infinitely wrong.
  error.percent_log = log_difference > 0 ? 100 * std::sqrt(log_difference / log_truth) : 0;
  error.percent_linear_cos = cos_difference > 0 ? 100 * std::sqrt(cos_difference / cos_truth) : 0;
  const auto middle = abs_log.begin() + static_cast<std::ptrdiff_t>(abs_log.size() / 2);
  std::nth_element(abs_log.begin(), middle, abs_log.end());
  error.median_abs_log = *middle;
  return error;
}

}  // namespace lightrig
