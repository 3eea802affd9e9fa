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

constexpr double centre = 210, radius = 175, disc = 8;
constexpr double least_dot = 1.2, greatest_dot = 3.8;

constexpr const char* style =
    "text{font:11px sans-serif;fill:#222}.name{text-anchor:middle}.note{text-anchor:middle;"
    "fill:#555}.title{font-weight:600}.paper{fill:#fff}.grid{fill:none;stroke:#ddd}.horizon{stroke:"
    "#888;stroke-dasharray:4 3}.candidate{fill:#4f7fae;fill-opacity:.75}.nothing{fill:#999}.out,"
    ".touch,.camera{fill:none;stroke-width:1}.out{stroke:#999}.touch{stroke:#c0392b}.camera{stroke:"
    "#8e44ad}.way{fill:none;stroke:#111;stroke-width:1.6;stroke-dasharray:2 "
    "4}.light{fill:#f4c36a;stroke:#8a5a00}"
    ".held{fill:#fff;stroke:#8a5a00}.on{fill:#222;font-size:10px}.lead{stroke:#8a5a00}.eye{fill:"
    "#0a7d5a}.bar{fill:#c98a2b}.none{fill:#"
    "e3d3bb}"
    "@media screen and "
    "(prefers-color-scheme:dark){text{fill:#ddd}.note{fill:#aaa}.paper{fill:#181a1d}"
    ".grid{stroke:#3a3d42}.horizon{stroke:#777}.candidate{fill:#7fb2e5}.nothing{fill:#666}.out{"
    "stroke:#888}.touch{stroke:#ff7566}.camera{stroke:#c58be0}.way{stroke:#fff}.on{fill:#222}.lead{"
    "stroke:#f4c36a}.eye{fill:#4fd0a5}.none{fill:"
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
Point on_sphere(const Eigen::Vector3d& d) {
  const double angle = std::acos(std::clamp(d.z(), -1.0, 1.0)) / std::numbers::pi;
  const double around = std::atan2(d.y(), d.x());
  return {centre + radius * angle * std::cos(around), centre - radius * angle * std::sin(around)};
}

Point on_sphere(const LightPosition& light, const Eigen::Vector3d& middle) {
  return on_sphere(light.direction_from(middle).normalized());
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

std::string camera_mark(const Point& at) {
  return fmt::format("<path d='M{:.1f} {:.1f}m-7 -4h9v8h-9zm9 4l5 -4v8z' class='eye'/>\n", at.x,
                     at.y);
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

double dot_size(int gain, int most) {
  return least_dot + (greatest_dot - least_dot) * std::sqrt(static_cast<double>(gain) / most);
}

int most_gain(const std::vector<int>& gain) {
  return gain.empty() ? 1 : std::max(1, *std::ranges::max_element(gain));
}

std::string candidate_dots(const Prepared& prepared) {
  const Eigen::Vector3d middle = middle_of(prepared);
  std::string svg;
  for (const UnusableCandidate& one : prepared.unusable)
    svg += cross(on_sphere(one.light, middle), class_of(one.why));
  const std::vector<int> gain = gains(prepared);
  const int most = most_gain(gain);
  for (std::size_t i = 0; i < prepared.candidates.size(); ++i) {
    const Point at = on_sphere(prepared.candidates[i].light, middle);
    const bool dark = prepared.bins.of(static_cast<int>(i)).empty();
    const double size = dark ? 1.0 : dot_size(gain[i], most);
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
  std::vector<Row> rows{{"<circle r='8' class='light'/>", "a light chosen, in order"},
                        {"<circle r='8' class='held'/><text y='3.5' class='name on'>H1</text>",
                         "captured to test the result, never fitted"},
                        {camera_mark({0, 0}), "the camera"},
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
  const int most = most_gain(gains(prepared));
  double y = centre + radius + 80;
  // The scale of the dots: by area, from nothing to the most.
  std::string svg =
      fmt::format("<text x='54' y='{:.1f}'>a candidate that would add</text>\n", y + 4);
  double x = 214;
  for (const int cells : {0, most / 4, most}) {
    if (cells == 0 && x > 214) continue;
    svg += fmt::format(
        "<circle cx='{0:.1f}' cy='{1:.1f}' r='{2:.1f}' class='candidate'/><text x='{3:.1f}' "
        "y='{4:.1f}'>{5}{6}</text>\n",
        x, y, dot_size(cells, most), x + 9, y + 4, cells,
        cells < most ? ""
        : cells == 1 ? " cell"
                     : " cells");
    x += 48;
  }
  y += 18;
  for (const Row& row : rows) {
    svg +=
        fmt::format("<g transform='translate(40 {:.1f})'>{}</g><text x='54' y='{:.1f}'>{}</text>\n",
                    y, row.mark, y + 4, row.words);
    y += 18;
  }
  return svg;
}

/// Where discs are drawn: beside one another where they would cover each other, each as near to its
/// direction as its neighbours leave room. The last one stays where it is.
std::vector<Point> apart(std::vector<Point> at) {
  constexpr double room = 2 * disc + 1;
  for (int round = 0; round < 200; ++round) {
    bool moved = false;
    for (std::size_t i = 0; i < at.size(); ++i)
      for (std::size_t j = 0; j < i; ++j) {
        double dx = at[i].x - at[j].x, dy = at[i].y - at[j].y, gap = std::hypot(dx, dy);
        if (gap >= room - 1e-3) continue;
        // At the same place: each pair its own way out.
        if (gap < 1e-6) {
          dx = std::cos(static_cast<double>(i));
          dy = std::sin(static_cast<double>(i));
          gap = 0;
        } else {
          dx /= gap;
          dy /= gap;
        }
        const bool fixed = i + 1 == at.size();
        const double push = fixed ? room - gap : (room - gap) / 2;
        if (!fixed) at[i] = {at[i].x + push * dx, at[i].y + push * dy};
        at[j] = {at[j].x - push * dx, at[j].y - push * dy};
        moved = true;
      }
    if (!moved) break;
  }
  return at;
}

std::string discs(const Plan& plan, const Eigen::Vector3d& middle, const Point& camera) {
  std::vector<Point> meant;
  for (const Shot& shot : plan.shots) meant.push_back(on_sphere(shot.light, middle));
  meant.push_back(camera);  // is not covered either
  const std::vector<Point> drawn = apart(meant);
  std::string leads, svg;
  for (std::size_t i = 0; i < plan.shots.size(); ++i) {
    const Point &at = drawn[i], &from = meant[i];
    if (std::hypot(at.x - from.x, at.y - from.y) > 1)
      leads += fmt::format(
          "<path d='M{0:.1f} {1:.1f}L{2:.1f} {3:.1f}' class='lead'/><circle cx='{0:.1f}' "
          "cy='{1:.1f}' r='2' class='light'/>\n",
          from.x, from.y, at.x, at.y);
    const std::string name = shot_name(plan, static_cast<int>(i));
    svg += fmt::format(
        "<circle cx='{0:.1f}' cy='{1:.1f}' r='{5:g}' class='{2}'/>"
        "<text x='{0:.1f}' y='{3:.1f}' class='name on'>{4}</text>\n",
        at.x, at.y, plan.shots[i].held_out ? "held" : "light", at.y + 3.5,
        fmt::format("{}{}", plan.shots[i].held_out ? "H" : "", std::stoi(name.substr(1))), disc);
  }
  return leads + svg;
}

/// Where the camera looks from; of one far away, against its line of sight.
Point camera_place(const CameraModel& camera, const Eigen::Vector3d& middle) {
  const Eigen::Isometry3d world_from_camera = camera.camera_from_world.inverse();
  const Eigen::Vector3d d = distant(camera)
                                ? Eigen::Vector3d(-world_from_camera.linear().col(2))
                                : Eigen::Vector3d(world_from_camera.translation() - middle);
  return on_sphere(d.normalized());
}

/// Which way is which: the azimuth is counted from +x towards +y.
std::string azimuths() {
  std::string svg = fmt::format("<path d='M{0} {1}h{2}M{1} {0}v{2}' class='grid'/>\n",
                                centre - radius, centre, 2 * radius);
  svg += fmt::format("<text x='{}' y='{}' class='note' style='text-anchor:start'>0° +x</text>\n",
                     centre + radius + 4, centre + 4);
  svg +=
      fmt::format("<text x='{}' y='{}' class='note'>90° +y</text>\n", centre, centre - radius - 6);
  svg += fmt::format("<text x='{}' y='{}' class='note' style='text-anchor:end'>180°</text>\n",
                     centre - radius - 4, centre + 4);
  svg +=
      fmt::format("<text x='{}' y='{}' class='note'>270°</text>\n", centre, centre + radius + 14);
  return svg;
}

std::string sphere(const Rig& rig, const Prepared& prepared) {
  const Plan& plan = prepared.plan;
  std::string svg;
  for (int degrees : {30, 60, 90, 120, 150, 180})
    svg += fmt::format("<circle cx='{0}' cy='{0}' r='{1:.1f}' class='grid{2}'/>\n", centre,
                       radius * degrees / 180, degrees == 90 ? " horizon" : "");
  svg += azimuths() + candidate_dots(prepared);
  const Eigen::Vector3d middle = middle_of(prepared);
  std::string way;
  for (int index : plan.visit_order) {
    const Point at = on_sphere(plan.shots[static_cast<std::size_t>(index)].light, middle);
    way += fmt::format("{:.1f},{:.1f} ", at.x, at.y);
  }
  svg += fmt::format("<polyline points='{}' class='way'/>\n", way);
  const Point camera = camera_place(rig.camera.model, middle);
  svg += discs(plan, middle, camera) + camera_mark(camera);
  std::vector<const char*> notes{
      "lamp directions from the object, from above; dashed: the horizon;",
      "rim: straight below; dotted: the way"};
  if (turns_object(rig.gantry.model))
    notes.push_back("as the object sees it: it is the object that turns under the lamp");
  double y = centre + radius + 30;
  for (const char* note : notes) {
    svg += fmt::format("<text x='{}' y='{}' class='note'>{}</text>\n", centre, y, note);
    y += 14;
  }
  return svg + legend(prepared);
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

std::string plan_svg(const Rig& rig, const Prepared& prepared) {
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
  const double height = std::max(640.0, 20 + 3 * block);
  // Readable on paper, and on a dark screen where the viewer asks for it.
  std::string svg = fmt::format(
      "<svg xmlns='http://www.w3.org/2000/svg' viewBox='0 0 780 {0:.0f}' width='780' "
      "height='{0:.0f}'>\n<style>{1}</style>\n"
      "<rect width='100%' height='100%' class='paper'/>\n",
      height, style);
  svg += sphere(rig, prepared);
  svg += bars(28, "predicted error with this light and all before it", error, error_words,
              Scale::linear);
  svg += bars(28 + block, "κ² with this light and all before it", condition, condition_words,
              Scale::logarithmic);
  svg += bars(28 + 2 * block, "cells this light adds", cells, cell_words, Scale::linear);
  return svg + "</svg>\n";
}

}  // namespace lightrig::cli
