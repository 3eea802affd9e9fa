#pragma once

#include <optional>
#include <vector>

#include "study/stability.h"

namespace lightrig {

/// A case from its numbers: the relative error and the verdict follow.
StabilityCase judged(std::string group, std::string name, double reference, double value,
                     std::optional<double> naive, double tolerance);

/// Of a case that no textbook formula answers.
inline constexpr std::nullopt_t no_naive = std::nullopt;

/// The cases by subject.
std::vector<StabilityCase> condition_cases();
std::vector<StabilityCase> posterior_cases();
std::vector<StabilityCase> angle_cases();
std::vector<StabilityCase> planner_cases();
std::vector<StabilityCase> geometry_cases();
std::vector<StabilityCase> material_cases();
std::vector<StabilityCase> fit_cases();
std::vector<StabilityCase> bracket_cases();
std::vector<StabilityCase> motion_cases();

}  // namespace lightrig
