#include "daemon/session/brdf_lookup.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace lightrig {
namespace {

// Smallest value a picture distinguishes from black [1/sr]; keeps ln finite.
constexpr double least_f = 1e-12;

bool usable(double f) { return std::isfinite(f) && f >= 0; }

// Index along one θd column of the nearest usable row, or −1.
int nearest_usable(const BrdfTable& table, int i_h, int i_d, int channel) {
  const BivariateGrid& grid = table.grid;
  for (int step = 0; step < grid.n_h; ++step) {
    for (const int i : {i_h - step, i_h + step}) {
      if (i >= 0 && i < grid.n_h && usable(table.f(grid.cell(i, i_d), channel))) return i;
    }
  }
  return -1;
}

struct Between {
  int low = 0, high = 0;
  double weight = 0;  ///< of high
};

// Cells whose centres (i + ½)/n enclose the fraction t of an axis.
Between between(double t, int n) {
  const double x = std::clamp(t * n - 0.5, 0.0, static_cast<double>(n - 1));
  const int low = std::min(static_cast<int>(x), std::max(0, n - 2));
  return {low, std::min(low + 1, n - 1), x - low};
}

}  // namespace

BrdfLookup::BrdfLookup(const BrdfTable& table)
    : grid_(table.grid), ln_f_(table.f.cols(), table.grid.cells()) {
  for (int channel = 0; channel < channels(); ++channel) {
    int last_column_with_value = -1;
    for (int i_d = 0; i_d < grid_.n_d; ++i_d) {
      bool any = false;
      for (int i_h = 0; i_h < grid_.n_h; ++i_h) {
        const int row = nearest_usable(table, i_h, i_d, channel);
        any = any || row >= 0;
        const double f = row >= 0 ? table.f(grid_.cell(row, i_d), channel) : 0.0;
        ln_f_(channel, grid_.cell(i_h, i_d)) = static_cast<float>(std::log(std::max(f, least_f)));
      }
      // A column without any value (grazing) continues its neighbour.
      if (!any && last_column_with_value >= 0) {
        for (int i_h = 0; i_h < grid_.n_h; ++i_h) {
          ln_f_(channel, grid_.cell(i_h, i_d)) =
              ln_f_(channel, grid_.cell(i_h, last_column_with_value));
        }
      }
      if (any) last_column_with_value = i_d;
    }
  }
}

double BrdfLookup::at(int cell, int channel) const {
  return std::exp(static_cast<double>(ln_f_(channel, cell)));
}

double BrdfLookup::operator()(double theta_h, double theta_d, int channel) const {
  const double per_right_angle = 2 / std::numbers::pi;
  const Between h = between(std::sqrt(std::max(0.0, theta_h) * per_right_angle), grid_.n_h);
  const Between d = between(theta_d * per_right_angle, grid_.n_d);
  const auto ln = [&](int i_h, int i_d) {
    return static_cast<double>(ln_f_(channel, grid_.cell(i_h, i_d)));
  };
  const double near = (1 - d.weight) * ln(h.low, d.low) + d.weight * ln(h.low, d.high);
  const double far = (1 - d.weight) * ln(h.high, d.low) + d.weight * ln(h.high, d.high);
  return std::exp((1 - h.weight) * near + h.weight * far);
}

}  // namespace lightrig
