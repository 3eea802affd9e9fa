#include "cli/plan_svg.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <vector>

#include "cli/say.h"
#include "daemon/session/session_folder.h"

namespace lightrig::cli {
namespace {

constexpr double centre = 210, radius = 185;

struct Point {
  double x, y;
};

// Azimuthal equidistant: the distance from the middle is the angle from straight above, the rim
// straight below, so that the whole sphere is seen.
Point on_sphere(const LightPosition& light) {
  const Eigen::Vector3d d = light.p.normalized();
  const double angle = std::acos(std::clamp(d.z(), -1.0, 1.0)) / std::numbers::pi;
  const double around = std::atan2(d.y(), d.x());
  return {centre + radius * angle * std::cos(around), centre - radius * angle * std::sin(around)};
}

std::string sphere(const Prepared& prepared) {
  const Plan& plan = prepared.plan;
  std::string svg;
  for (int degrees : {30, 60, 90, 120, 150, 180})
    svg += fmt::format("<circle cx='{0}' cy='{0}' r='{1:.1f}' class='grid{2}'/>\n", centre,
                       radius * degrees / 180, degrees == 90 ? " horizon" : "");
  for (const Candidate& candidate : prepared.candidates) {
    const Point at = on_sphere(candidate.light);
    svg += fmt::format("<circle cx='{:.1f}' cy='{:.1f}' r='1.2' class='candidate'/>\n", at.x, at.y);
  }
  std::string way;
  for (int index : plan.visit_order) {
    const Point at = on_sphere(plan.shots[static_cast<std::size_t>(index)].light);
    way += fmt::format("{:.1f},{:.1f} ", at.x, at.y);
  }
  svg += fmt::format("<polyline points='{}' class='way'/>\n", way);
  for (std::size_t i = 0; i < plan.shots.size(); ++i) {
    const Point at = on_sphere(plan.shots[i].light);
    svg += fmt::format(
        "<circle cx='{0:.1f}' cy='{1:.1f}' r='9' class='{2}'/>"
        "<text x='{0:.1f}' y='{3:.1f}' class='name'>{4}</text>\n",
        at.x, at.y, plan.shots[i].held_out ? "held" : "light", at.y + 3.5,
        plan.shots[i].held_out ? "H" : std::to_string(i + 1));
  }
  return svg + fmt::format(
                   "<text x='{}' y='{}' class='note'>from above; dashed: the horizon; "
                   "rim: straight below</text>\n",
                   centre, centre + radius + 18);
}

// One bar per light; its length on a logarithmic scale between the least and the greatest value.
std::string bars(double top, const char* title, const std::vector<double>& values,
                 const std::vector<std::string>& words) {
  double least = std::numeric_limits<double>::infinity(), most = 0;
  for (double value : values)
    if (std::isfinite(value) && value > 0) {
      least = std::min(least, value);
      most = std::max(most, value);
    }
  std::string svg = fmt::format("<text x='440' y='{}' class='title'>{}</text>\n", top, title);
  for (std::size_t i = 0; i < values.size(); ++i) {
    const double y = top + 10 + 15 * static_cast<double>(i);
    const bool usable = std::isfinite(values[i]) && values[i] > 0;
    const double part = !usable        ? 1
                        : most > least ? std::log(values[i] / least) / std::log(most / least)
                                       : 1;
    const double width = 8 + 180 * part;
    svg += fmt::format(
        "<text x='452' y='{0:.1f}' class='name'>{1}</text><rect x='464' y='{2:.1f}' "
        "width='{3:.1f}' "
        "height='10' class='bar{4}'/><text x='{5:.1f}' y='{0:.1f}' class='value'>{6}</text>\n",
        y + 9, i + 1, y, width, usable ? "" : " none", 470 + width, words[i]);
  }
  return svg;
}

}  // namespace

std::string plan_svg(const Prepared& prepared) {
  std::vector<double> error, condition, cells;
  std::vector<std::string> error_words, condition_words, cell_words;
  for (const Shot& shot : prepared.plan.shots) {
    if (shot.held_out) continue;
    const SelectedLight& light = shot.selection;
    error.push_back(light.predicted_error_percent);
    error_words.push_back(percent(light.predicted_error_percent));
    condition.push_back(light.condition);
    condition_words.push_back(figure(light.condition));
    cells.push_back(light.new_cells);
    cell_words.push_back(std::to_string(light.new_cells));
  }
  const double block = 40 + 15 * static_cast<double>(error.size());
  const double height = std::max(440.0, 20 + 3 * block);
  std::string svg = fmt::format(
      "<svg xmlns='http://www.w3.org/2000/svg' viewBox='0 0 780 {0:.0f}' width='780' "
      "height='{0:.0f}'>\n<style>text{{font:11px sans-serif;fill:#222}}.name{{text-anchor:middle}}"
      ".note{{text-anchor:middle;fill:#666}}.title{{font-weight:600}}.grid{{fill:none;stroke:#ddd}}"
      ".horizon{{stroke:#999;stroke-dasharray:4 3}}.candidate{{fill:#bbb}}.way{{fill:none;stroke:"
      "#777;stroke-dasharray:2 4}}.light{{fill:#f4c36a;stroke:#8a5a00}}.held{{fill:#fff;stroke:"
      "#8a5a00}}.bar{{fill:#c98a2b}}.none{{fill:#e3d3bb}}</style>\n"
      "<rect width='100%' height='100%' fill='#fff'/>\n",
      height);
  svg += sphere(prepared);
  svg += bars(28, "predicted error with this light and all before it", error, error_words);
  svg += bars(28 + block, "κ² with this light and all before it", condition, condition_words);
  svg += bars(28 + 2 * block, "cells this light adds", cells, cell_words);
  return svg + "</svg>\n";
}

}  // namespace lightrig::cli
