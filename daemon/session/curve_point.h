#pragma once

#include <optional>

namespace lightrig {

/// What was known after so many lights.
struct CurvePoint {
  int lights = 0;        ///< fitted, held-out ones not counted
  double elapsed_s = 0;  ///< measured rig time
  double predicted_error_percent = 0, predicted_low_percent = 0, predicted_high_percent = 0;
  std::optional<double>
      held_out_error_percent;  ///< image of the held-out light: predicted against captured
  std::optional<double> true_error_percent;  ///< against a known reference

  bool operator==(const CurvePoint&) const = default;
};

}  // namespace lightrig
