#pragma once

#include <vector>

#include "study/stability.h"

namespace lightrig {

/// A case from its numbers: the relative error and the verdict follow.
StabilityCase judged(std::string group, std::string name, double reference, double value,
                     double naive, double tolerance);

/// The cases by subject.
std::vector<StabilityCase> condition_cases();
std::vector<StabilityCase> posterior_cases();
std::vector<StabilityCase> angle_cases();
std::vector<StabilityCase> planner_cases();
std::vector<StabilityCase> geometry_cases();
std::vector<StabilityCase> material_cases();
std::vector<StabilityCase> bracket_cases();
std::vector<StabilityCase> motion_cases();

}  // namespace lightrig
