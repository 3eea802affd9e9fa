#include "core/refine.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

#include "core/check.h"

namespace lightrig {
namespace {

/// Share of a correction that is doubted [ln units per ln unit].
constexpr double doubt = 0.3;
/// A correction beyond e^3 says that the estimate is no guide there.
constexpr double most_correction = 3;
constexpr double darkest = 1e-6;  ///< [1/sr]
constexpr int rounds = 2;

/// ln f̂ as a continuous function of the grid's coordinates.
class LogTable {
 public:
  explicit LogTable(const BrdfTable& table) : grid_(table.grid), ln_(table.f.max(darkest).log()) {}

  double centre(int cell, Eigen::Index channel) const { return ln_(cell, channel); }

  /// Bilinear between centres; cells without a value are left out, `else_value` where all are.
  double at(double h, double d, Eigen::Index channel, double else_value) const {
    const double x = std::clamp(h - 0.5, 0.0, grid_.n_h - 1.0);
    const double y = std::clamp(d - 0.5, 0.0, grid_.n_d - 1.0);
    const int i = std::min(static_cast<int>(x), std::max(0, grid_.n_h - 2));
    const int j = std::min(static_cast<int>(y), std::max(0, grid_.n_d - 2));
    const double u = x - i, v = y - j;
    double sum = 0, weights = 0;
    for (int corner = 0; corner < 4; ++corner) {
      const int up = corner & 1, right = corner >> 1;
      const double weight = (up != 0 ? u : 1 - u) * (right != 0 ? v : 1 - v);
      if (!(weight > 0)) continue;
      const double ln = ln_(grid_.cell(i + up, j + right), channel);
      if (!std::isfinite(ln)) continue;
      sum += weight * ln;
      weights += weight;
    }
    return weights > 0.05 ? sum / weights : else_value;
  }

 private:
  BivariateGrid grid_;
  Eigen::ArrayXXd ln_;  ///< (cells × C)
};

/// What the footprints of one row say.
struct RowSum {
  double weight = 0;
  double predicted = 0;  ///< Σ weight · f̂ e^d
  double unsaid = 0;     ///< Σ weight · variance of d
};

/// What φd does at the footprints of a light: footprints of one row and one part of φd share it.
struct AzimuthEffects {
  std::vector<std::size_t> place_of;  ///< (footprints)
  std::vector<double> factor;         ///< (places) e^d
  std::vector<double> unsaid;         ///< (places) variance of d
};

AzimuthEffects azimuth_effects(const BrdfObservations& light, const AzimuthModel& azimuths,
                               const Coefficients& estimate) {
  AzimuthEffects out;
  if (azimuths.none()) {
    out.place_of.assign(light.footprints.size(), 0);
    out.factor = {1};
    out.unsaid = {0};
    return out;
  }
  const Eigen::MatrixXf weights = azimuths.weights(estimate.c);
  std::vector<std::array<std::int32_t, azimuth_bins>> known(light.rows.size());
  for (auto& row : known) row.fill(-1);
  std::vector<std::pair<int, double>> places;
  for (const Footprint& f : light.footprints) {
    const auto row = static_cast<std::size_t>(f.row);
    const double share = double{f.azimuth};
    const int bin = std::clamp(static_cast<int>(share * azimuth_bins), 0, azimuth_bins - 1);
    std::int32_t& place = known[row][static_cast<std::size_t>(bin)];
    if (place < 0) {
      place = static_cast<std::int32_t>(places.size());
      const BrdfObservation& seen = light.rows[row];
      places.emplace_back(seen.cell, share);
      const Eigen::VectorXf departure =
          azimuths.departure(seen.cell, share, weights.col(seen.channel));
      out.factor.push_back(std::exp(double{departure[0]}));
    }
    out.place_of.push_back(static_cast<std::size_t>(place));
  }
  out.unsaid = azimuths.variance(places);
  return out;
}

}  // namespace

BrdfObservations refined(const BrdfObservations& light, const BrdfBasis& basis,
                         const AzimuthModel& azimuths, const Coefficients& estimate) {
  BrdfObservations out = light;
  if (light.footprints.empty()) return out;
  const LogTable table(evaluate(basis, estimate.c));
  const AzimuthEffects effects = azimuth_effects(light, azimuths, estimate);
  std::vector<RowSum> sums(light.rows.size());
  for (std::size_t i = 0; i < light.footprints.size(); ++i) {
    const Footprint& f = light.footprints[i];
    const BrdfObservation& row = light.rows[static_cast<std::size_t>(f.row)];
    if (basis.valid[static_cast<std::size_t>(row.cell)] == 0) continue;
    const double centre = table.centre(row.cell, row.channel);
    double seen = 0;
    for (std::size_t k = 0; k < 4; ++k) {
      seen += std::exp(table.at(double{f.h[k]}, double{f.d[k]}, row.channel, centre)) / 4;
    }
    const std::size_t place = effects.place_of[i];
    seen *= effects.factor[place];
    RowSum& sum = sums[static_cast<std::size_t>(f.row)];
    sum.weight += double{f.weight};
    sum.predicted += double{f.weight} * seen;
    sum.unsaid += double{f.weight} * effects.unsaid[place];
  }
  for (std::size_t i = 0; i < sums.size(); ++i) {
    const RowSum& sum = sums[i];
    BrdfObservation& row = out.rows[i];
    if (!(sum.weight > 0) || !(row.f > 0)) continue;
    const double ln_factor =
        std::clamp(table.centre(row.cell, row.channel) - std::log(sum.predicted / sum.weight),
                   -most_correction, most_correction);
    const double relative = row.variance / (row.f * row.f);
    const double doubted = doubt * ln_factor;
    row.f *= std::exp(ln_factor);
    row.variance = (relative + doubted * doubted + sum.unsaid / sum.weight) * row.f * row.f;
  }
  return out;
}

AdaptiveFit fit_refined(const BrdfBasis& basis, const AzimuthModel& azimuths,
                        std::span<const BrdfObservations> lights, int channels,
                        const FitOptions& options) {
  AdaptiveFit fitted = fit_adaptive(basis, lights, channels, options);
  const bool any = std::any_of(lights.begin(), lights.end(),
                               [](const BrdfObservations& o) { return !o.footprints.empty(); });
  // Without a prior an estimate swings wildly where no light looked: no guide to correct by.
  if (!any || options.estimator != Estimator::map || basis.layout != ChannelLayout::columns) {
    return fitted;
  }
  for (int round = 0; round < rounds; ++round) {
    std::vector<BrdfObservations> rows;
    rows.reserve(lights.size());
    for (const BrdfObservations& light : lights) {
      rows.push_back(refined(light, basis, azimuths, fitted.coefficients));
    }
    fitted = fit_adaptive(basis, rows, channels, options);
  }
  return fitted;
}

}  // namespace lightrig
