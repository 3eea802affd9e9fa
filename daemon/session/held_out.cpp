#include "daemon/session/held_out.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace lightrig {
namespace {

// On fits of MERL the posterior holds the whole table to be 1.1 to 2.4 times as uncertain as the
// bins of one light; a posterior that says far more is overconfident where lights have looked.
constexpr double most_scaling = 2.5;

struct Mean {
  double sum = 0, weights = 0;

  void add(double value, double weight = 1) {
    sum += weight * value;
    weights += weight;
  }
  double value() const { return weights > 0 ? sum / weights : 0; }
};

double square(double x) { return x * x; }

}  // namespace

HeldOutError held_out_error(std::span<const BrdfObservations> held_out,
                            const Reconstruction& reconstruction, double floor) {
  const BrdfTable& brdf = reconstruction.brdf;
  Mean level, uncertainty;
  for (Eigen::Index channel = 0; channel < brdf.f.cols(); ++channel) {
    for (Eigen::Index cell = 0; cell < brdf.f.rows(); ++cell) {
      if (!std::isfinite(brdf.f(cell, channel))) continue;
      level.add(square(std::log(std::max(brdf.f(cell, channel), floor))));
      uncertainty.add(square(reconstruction.log_stddev(cell, channel)));
    }
  }
  HeldOutError error;
  Mean misfit, noise, uncertainty_seen;
  double scatter2 = 0;  // of the sum of weighted squared misfits
  for (const BrdfObservations& light : held_out) {
    for (const BrdfObservation& row : light.rows) {
      if (row.kind != BrdfObservation::Kind::value || row.channel >= brdf.f.cols()) continue;
      const double f = brdf.f(row.cell, row.channel);
      if (!std::isfinite(f) || !(row.f > 0)) continue;
      const double measured = std::max(row.f, floor);
      const double noise2 = row.variance / square(measured);
      const double posterior2 = square(reconstruction.log_stddev(row.cell, row.channel));
      if (!(noise2 + posterior2 > 0)) continue;
      // A squared misfit scatters by twice the square of what is expected of it.
      const double weight = 1 / square(noise2 + posterior2);
      scatter2 += 2 * weight;  // (weight · √2 · expected)²
      misfit.add(square(std::log(std::max(f, floor) / measured)), weight);
      noise.add(noise2, weight);
      uncertainty_seen.add(posterior2, weight);
      ++error.rows;
    }
  }
  if (error.rows == 0 || !(level.value() > 0)) {
    error.percent = error.seen_percent = std::numeric_limits<double>::quiet_NaN();
    return error;
  }
  const double least_told = std::sqrt(scatter2) / misfit.weights;
  const double beyond_noise = std::max(misfit.value() - noise.value(), least_told);
  error.seen_percent = 100 * std::sqrt(beyond_noise / level.value());
  error.percent = error.seen_percent;
  if (uncertainty_seen.value() > 0) {
    error.percent *=
        std::clamp(std::sqrt(uncertainty.value() / uncertainty_seen.value()), 1.0, most_scaling);
  }
  return error;
}

}  // namespace lightrig
