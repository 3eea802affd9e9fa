#include "study/stability.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "study/stability_cases.h"

namespace lightrig {

namespace {

std::string json_number(double x) { return std::isfinite(x) ? fmt::format("{:.17g}", x) : "null"; }

}  // namespace

StabilityCase judged(std::string group, std::string name, double reference, double value,
                     std::optional<double> naive, double tolerance) {
  StabilityCase c{std::move(group), std::move(name), reference, value, 0, naive, tolerance, false};
  if (reference == value) {
    c.relative_error = 0;
  } else if (!std::isfinite(reference) || !std::isfinite(value)) {
    c.relative_error = std::numeric_limits<double>::infinity();
  } else {
    c.relative_error = std::abs(value - reference) / std::max(std::abs(reference), 1e-300);
  }
  c.pass = c.relative_error <= tolerance;
  return c;
}

int StabilityReport::failed() const {
  return static_cast<int>(
      std::count_if(cases.begin(), cases.end(), [](const StabilityCase& c) { return !c.pass; }));
}

StabilityReport run_stability() {
  StabilityReport report;
  for (const auto& cases :
       {condition_cases(), posterior_cases(), angle_cases(), planner_cases(), geometry_cases(),
        material_cases(), fit_cases(), bracket_cases(), motion_cases()}) {
    report.cases.insert(report.cases.end(), cases.begin(), cases.end());
  }
  return report;
}

std::string stability_text(const StabilityReport& report) {
  std::string out = fmt::format("{:<11} {:<58} {:>16} {:>16} {:>9} {:>12}\n", "subject", "case",
                                "reference", "lightrig", "rel.err", "naive");
  for (const StabilityCase& c : report.cases) {
    out += fmt::format("{:<11} {:<58} {:>16.9g} {:>16.9g} {:>9.1e} {:>12}  {}\n", c.group, c.name,
                       c.reference, c.value, c.relative_error,
                       c.naive ? fmt::format("{:.5g}", *c.naive) : "–",
                       c.pass ? "ok" : fmt::format("FAILED (at most {:.0e})", c.tolerance));
  }
  out += fmt::format("cases={} failed={}\n", report.cases.size(), report.failed());
  return out;
}

std::string stability_json(const StabilityReport& report) {
  std::string out = "{\"cases\": [";
  const char* separator = "\n  ";
  for (const StabilityCase& c : report.cases) {
    out += fmt::format(
        "{}{{\"group\": \"{}\", \"name\": \"{}\", \"reference\": {}, \"value\": {}, "
        "\"relative_error\": {}, \"naive\": {}, \"tolerance\": {}, \"pass\": {}}}",
        separator, c.group, c.name, json_number(c.reference), json_number(c.value),
        json_number(c.relative_error), c.naive ? json_number(*c.naive) : "null",
        json_number(c.tolerance), c.pass);
    separator = ",\n  ";
  }
  return out + fmt::format("\n], \"failed\": {}}}\n", report.failed());
}

}  // namespace lightrig
