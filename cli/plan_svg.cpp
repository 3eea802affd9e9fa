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

constexpr const char* style =
    "text{font:11px sans-serif;fill:#222}.name{text-anchor:middle}.note{text-anchor:middle;"
    "fill:#555}.title{font-weight:600}.paper{fill:#fff}.grid{fill:none;stroke:#ddd}.horizon{stroke:"
    "#888;stroke-dasharray:4 3}.candidate{fill:#4f7fae;fill-opacity:.75}.nothing{fill:#999}.out,"
    ".touch,.camera{fill:none;stroke-width:1}.out{stroke:#ccc}.touch{stroke:#c0392b}.camera{stroke:"
    "#8e44ad}.way{fill:none;stroke:#111;stroke-width:1.6;stroke-dasharray:2 "
    "4}.light{fill:#f4c36a;stroke:#8a5a00}"
    ".held{fill:#fff;stroke:#8a5a00}.on{fill:#222}.bar{fill:#c98a2b}.none{fill:#e3d3bb}"
    "@media screen and "
    "(prefers-color-scheme:dark){text{fill:#ddd}.note{fill:#aaa}.paper{fill:#181a1d}"
    ".grid{stroke:#3a3d42}.horizon{stroke:#777}.candidate{fill:#7fb2e5}.nothing{fill:#666}.out{"
    "stroke:"
    "#555}.touch{stroke:#ff7566}.camera{stroke:#c58be0}.way{stroke:#fff}.on{fill:#222}.none{fill:"
    "#6b5a3c}}";

struct Point {
  double x, y;
};

/// The middle of what is measured: lamp directions are as it sees them, wherever the world has its
/// origin.
Eigen::Vector3d middle_of(const Prepared& prepared) {
  const auto& vertices = prepared.object.mesh.vertices;
  return 0.5 * (vertices.rowwise().minCoeff() + vertices.rowwise().maxCoeff());
}

// Azimuthal equidistant: the distance from the middle is the angle from straight above, the rim
// straight below, so that the whole sphere is seen.
Point on_sphere(const LightPosition& light, const Eigen::Vector3d& middle) {
  const Eigen::Vector3d d = light.direction_from(middle).normalized();
  const double angle = std::acos(std::clamp(d.z(), -1.0, 1.0)) / std::numbers::pi;
  const double around = std::atan2(d.y(), d.x());
  return {centre + radius * angle * std::cos(around), centre - radius * angle * std::sin(around)};
}

const char* class_of(NotUsable why) {
  switch (why) {
    case NotUsable::unreachable:
      return "out";
    case NotUsable::kept_out:
      return "touch";
    case NotUsable::in_view:
    case NotUsable::into_lens:
    case NotUsable::hides:
      break;
  }
  return "camera";
}

std::string cross(const Point& at, const char* kind) {
  return fmt::format("<path d='M{:.1f} {:.1f}l4 4m0 -4l-4 4' class='{}'/>\n", at.x - 2, at.y - 2,
                     kind);
}

// What a candidate would add to the chosen lights: cells that none of them shows.
std::vector<int> gains(const Prepared& prepared) {
  const CandidateBins& bins = prepared.bins;
  std::vector<bool> shown(static_cast<std::size_t>(bins.grid.cells()), false);
  for (const Shot& shot : prepared.plan.shots) {
    if (shot.held_out) continue;
    for (const std::int32_t cell : bins.of(shot.candidate))
      shown[static_cast<std::size_t>(cell)] = true;
  }
  std::vector<int> gain;
  for (int i = 0; i < bins.candidates(); ++i) {
    int added = 0;
    for (const std::int32_t cell : bins.of(i)) added += !shown[static_cast<std::size_t>(cell)];
    gain.push_back(added);
  }
  return gain;
}

std::string candidate_dots(const Prepared& prepared) {
  const Eigen::Vector3d middle = middle_of(prepared);
  std::string svg;
  for (const UnusableCandidate& one : prepared.unusable)
    svg += cross(on_sphere(one.light, middle), class_of(one.why));
  const std::vector<int> gain = gains(prepared);
  const int most = std::max(1, gain.empty() ? 1 : *std::max_element(gain.begin(), gain.end()));
  for (std::size_t i = 0; i < prepared.candidates.size(); ++i) {
    const Point at = on_sphere(prepared.candidates[i].light, middle);
    const bool dark = prepared.bins.of(static_cast<int>(i)).empty();
    const double size = dark ? 1.0 : 1.3 + 2.2 * std::sqrt(static_cast<double>(gain[i]) / most);
    svg += fmt::format("<circle cx='{:.1f}' cy='{:.1f}' r='{:.1f}' class='{}'/>\n", at.x, at.y,
                       size, dark ? "nothing" : "candidate");
  }
  return svg;
}

std::string legend(const Prepared& prepared) {
  const auto count = [&](auto kinds) {
    return std::count_if(prepared.unusable.begin(), prepared.unusable.end(), kinds);
  };
  struct Row {
    std::string mark, words;
  };
  const auto crossed = [](const char* kind) { return cross({0, 0}, kind); };
  std::vector<Row> rows{
      {"<circle r='7' class='light'/>", "a light chosen, in order"},
      {"<circle r='7' class='held'/>", "captured to test the result, never fitted"},
      {"<circle r='3.5' class='candidate'/>",
       "a candidate; the larger, the more cells it would add to those chosen"},
      {"<circle r='1' class='nothing'/>", "a candidate that shows nothing"}};
  const auto add = [&](const char* kind, std::int64_t n, const char* words) {
    if (n > 0) rows.push_back({crossed(kind), fmt::format("{} {}", n, words)});
  };
  add("out", count([](const auto& u) { return u.why == NotUsable::unreachable; }),
      "out of the gantry's travel");
  add("touch", count([](const auto& u) { return u.why == NotUsable::kept_out; }),
      "where lamp or arm would touch something");
  add("camera", count([](const auto& u) { return class_of(u.why) == std::string("camera"); }),
      "in the camera's way, or shining into its lens");
  std::string svg;
  double y = centre + radius + 52;
  for (const Row& row : rows) {
    svg +=
        fmt::format("<g transform='translate(40 {:.1f})'>{}</g><text x='54' y='{:.1f}'>{}</text>\n",
                    y, row.mark, y + 4, row.words);
    y += 18;
  }
  return svg;
}

std::string sphere(const Prepared& prepared) {
  const Plan& plan = prepared.plan;
  std::string svg;
  for (int degrees : {30, 60, 90, 120, 150, 180})
    svg += fmt::format("<circle cx='{0}' cy='{0}' r='{1:.1f}' class='grid{2}'/>\n", centre,
                       radius * degrees / 180, degrees == 90 ? " horizon" : "");
  svg += candidate_dots(prepared);
  const Eigen::Vector3d middle = middle_of(prepared);
  std::string way;
  for (int index : plan.visit_order) {
    const Point at = on_sphere(plan.shots[static_cast<std::size_t>(index)].light, middle);
    way += fmt::format("{:.1f},{:.1f} ", at.x, at.y);
  }
  svg += fmt::format("<polyline points='{}' class='way'/>\n", way);
  for (std::size_t i = 0; i < plan.shots.size(); ++i) {
    const Point at = on_sphere(plan.shots[i].light, middle);
    svg += fmt::format(
        "<circle cx='{0:.1f}' cy='{1:.1f}' r='9' class='{2}'/>"
        "<text x='{0:.1f}' y='{3:.1f}' class='name on'>{4}</text>\n",
        at.x, at.y, plan.shots[i].held_out ? "held" : "light", at.y + 3.5,
        plan.shots[i].held_out ? "H" : std::to_string(i + 1));
  }
  return svg +
         fmt::format(
             "<text x='{0}' y='{1}' class='note'>lamp directions from the object, from above; "
             "dashed: the horizon;"
             "</text>\n<text x='{0}' y='{2}' class='note'>rim: straight below; dotted: the way"
             "</text>\n",
             centre, centre + radius + 16, centre + radius + 30) +
         legend(prepared);
}

enum class Scale : std::uint8_t { logarithmic, linear };

// One bar per light; its length from zero, or on a logarithmic scale between the least and the
// greatest value.
std::string bars(double top, const char* title, const std::vector<double>& values,
                 const std::vector<std::string>& words, Scale scale) {
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
    const double part = !usable                  ? 1
                        : scale == Scale::linear ? values[i] / most
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
  const double height = std::max(590.0, 20 + 3 * block);
  // Readable on paper, and on a dark screen where the viewer asks for it.
  std::string svg = fmt::format(
      "<svg xmlns='http://www.w3.org/2000/svg' viewBox='0 0 780 {0:.0f}' width='780' "
      "height='{0:.0f}'>\n<style>{1}</style>\n"
      "<rect width='100%' height='100%' class='paper'/>\n",
      height, style);
  svg += sphere(prepared);
  svg += bars(28, "predicted error with this light and all before it", error, error_words,
              Scale::linear);
  svg += bars(28 + block, "κ² with this light and all before it", condition, condition_words,
              Scale::logarithmic);
  svg += bars(28 + 2 * block, "cells this light adds", cells, cell_words, Scale::linear);
  return svg + "</svg>\n";
}

}  // namespace lightrig::cli
