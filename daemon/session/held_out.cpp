#include "daemon/session/held_out.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace lightrig {
namespace {

struct MeanSquare {
  double sum = 0;
  std::int64_t count = 0;

  void add(double value) {
    sum += value * value;
    ++count;
  }
  double mean() const { return count > 0 ? sum / static_cast<double>(count) : 0; }
};

}  // namespace

HeldOutError held_out_error(std::span<const BrdfObservations> held_out,
                            const Reconstruction& reconstruction, double floor) {
  const BrdfTable& brdf = reconstruction.brdf;
  MeanSquare level, uncertainty;
  for (Eigen::Index channel = 0; channel < brdf.f.cols(); ++channel) {
    for (Eigen::Index cell = 0; cell < brdf.f.rows(); ++cell) {
      if (!std::isfinite(brdf.f(cell, channel))) continue;
      level.add(std::log(std::max(brdf.f(cell, channel), floor)));
      uncertainty.add(reconstruction.log_stddev(cell, channel));
    }
  }
  MeanSquare misfit, noise, uncertainty_seen;
  for (const BrdfObservations& light : held_out) {
    for (const BrdfObservation& row : light.rows) {
      if (row.kind != BrdfObservation::Kind::value || row.channel >= brdf.f.cols()) continue;
      const double f = brdf.f(row.cell, row.channel);
      if (!std::isfinite(f) || !(row.f > 0)) continue;
      const double measured = std::max(row.f, floor);
      misfit.add(std::log(std::max(f, floor)) - std::log(measured));
      noise.add(std::sqrt(row.variance) / measured);
      uncertainty_seen.add(reconstruction.log_stddev(row.cell, row.channel));
    }
  }
  HeldOutError error;
  error.rows = static_cast<int>(misfit.count);
  if (misfit.count == 0 || !(level.mean() > 0)) {
    error.percent = error.seen_percent = std::numeric_limits<double>::quiet_NaN();
    return error;
  }
  error.seen_percent = 100 * std::sqrt(std::max(0.0, misfit.mean() - noise.mean()) / level.mean());
  error.percent = error.seen_percent;
  if (uncertainty_seen.mean() > 0) {
    error.percent *= std::sqrt(uncertainty.mean() / uncertainty_seen.mean());
  }
  return error;
}

}  // namespace lightrig
