#pragma once

#include <optional>
#include <string>
#include <vector>

namespace lightrig {

/// One stiff or extreme input: what high precision says, what lightrig says, and what a naive
/// formula makes of it.
struct StabilityCase {
  std::string group;          ///< "condition", "angles", "planner", …
  std::string name;           ///< one line: the input
  double reference = 0;       ///< from 100 decimal digits, or by hand where exact; may be infinite
  double value = 0;           ///< lightrig's
  double relative_error = 0;  ///< |value − reference| / |reference|; 0 where both are infinite
  std::optional<double> naive;  ///< what the textbook formula in double precision gives, computed
                                ///< here; empty where there is none to go wrong
  double tolerance = 0;         ///< of relative_error
  bool pass = false;
};

struct StabilityReport {
  std::vector<StabilityCase> cases;
  int failed() const;
};

/// Runs every case; the same numbers every time. A few seconds.
StabilityReport run_stability();

/// A table for people, ending with one line `cases= failed=`; and the same as JSON (infinite, and
/// no naive formula, as null).
std::string stability_text(const StabilityReport& report);
std::string stability_json(const StabilityReport& report);

}  // namespace lightrig
