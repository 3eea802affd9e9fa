#include "core/light.h"

#include <algorithm>
#include <cmath>

namespace lightrig {

double EmissionLobe::towards(double cos_angle) const {
  if (uniform()) return 1;
  if (angle.empty()) return cos_angle > 0 ? std::pow(std::min(cos_angle, 1.0), exponent) : 0.0;
  const double a = std::acos(std::clamp(cos_angle, -1.0, 1.0));
  if (a > angle.back()) return 0;
  const auto upper = std::upper_bound(angle.begin(), angle.end(), a);
  if (upper == angle.begin()) return intensity.front();
  if (upper == angle.end()) return intensity.back();
  const auto i = static_cast<std::size_t>(upper - angle.begin());
  const double share = (a - angle[i - 1]) / (angle[i] - angle[i - 1]);
  return intensity[i - 1] + share * (intensity[i] - intensity[i - 1]);
}

}  // namespace lightrig
