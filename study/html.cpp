#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>

#include "daemon/session/report_text.h"
#include "study/job.h"
#include "study/report.h"

namespace lightrig {
namespace {

constexpr const char* style = R"(<style>
:root{--ink:#1a1a1a;--paper:#fff;--grid:#ddd;--soft:#666}
@media(prefers-color-scheme:dark){:root{--ink:#e6e6e6;--paper:#15171a;--grid:#33373d;--soft:#9aa0a8}}
@media print{:root{--ink:#000;--paper:#fff;--grid:#ccc;--soft:#444}}
body{background:var(--paper);color:var(--ink);font:15px/1.5 system-ui,sans-serif;max-width:1360px;margin:2rem auto;padding:0 1rem}
.charts{display:grid;grid-template-columns:repeat(auto-fit,minmax(min(100%,560px),1fr));gap:1.2rem}
svg{width:100%;height:auto}svg text{fill:var(--ink);font-size:12px}svg .t{font-size:14px;font-weight:600}
svg .g{stroke:var(--grid)}svg .d{stroke:var(--ink);stroke-dasharray:5 3}
.spheres{display:flex;flex-wrap:wrap;gap:1.2rem}figure{margin:0}figcaption{text-align:center}.spheres img{max-width:100%}
.wide{overflow-x:auto}table{border-collapse:collapse;font-size:13px}td,th{padding:2px 10px;text-align:right;border-bottom:1px solid var(--grid)}
td:first-child,th:first-child,td:nth-child(3),th:nth-child(3){text-align:left}p{max-width:80ch}.soft{color:var(--soft)}
pre{font-size:12px;overflow-x:auto}th{vertical-align:bottom}
@media(max-width:640px){body{margin:1rem auto}ul{padding-left:1.2rem}svg text,svg .t{font-size:18px}}
@page{margin:12mm}
@media print{body{margin:0;padding:0;max-width:none;font-size:10pt}.wide,pre{overflow:visible}pre{white-space:pre-wrap;font-size:6pt}
table{font-size:6.5pt;width:100%}td,th{padding:1px 3px}tr,figure,svg{break-inside:avoid}h2{break-after:avoid}
.charts{grid-template-columns:1fr 1fr;gap:4mm}svg text,svg .t{font-size:17px}.spheres figure{width:47%}}
</style>)";

std::string escaped(const std::string& text) {
  std::string out;
  for (const char c : text) {
    if (c == '<') {
      out += "&lt;";
    } else if (c == '&') {
      out += "&amp;";
    } else {
      out += c;
    }
  }
  return out;
}

using Figures = std::vector<StudyFigure>;

std::vector<std::string> methods_in(const Figures& figures, const StudyIdentity& identity,
                                    const std::string& object) {
  std::vector<std::string> out;
  for (const std::string& method : identity.methods) {
    for (const StudyFigure& f : figures) {
      if (f.object == object && f.method == method && f.lights > 0) {
        out.push_back(method);
        break;
      }
    }
  }
  return out;
}

/// A method has one colour wherever it is drawn.
int colour_of(const StudyIdentity& identity, const std::string& method) {
  const auto at = std::find(identity.methods.begin(), identity.methods.end(), method);
  return static_cast<int>(at - identity.methods.begin());
}

/// Error against lights, or against rig minutes with what is worth them: one line per method.
StudyChart error_chart(const Figures& figures, const StudyIdentity& identity,
                       const std::string& object, bool time) {
  StudyChart chart;
  chart.title = object + (time ? ": error against run time" : ": error against lights");
  chart.x_label = time ? "rig time [min]" : "lights";
  chart.y_label = "median error of ln f [%]";
  chart.log_y = true;
  std::vector<std::pair<double, double>> all;
  for (const std::string& method : methods_in(figures, identity, object)) {
    StudySeries series{method, {}, false, false, colour_of(identity, method)};
    for (const StudyFigure& f : figures) {
      if (f.object == object && f.method == method) {
        series.points.emplace_back(time ? f.minutes : f.lights, f.median);
      }
    }
    all.insert(all.end(), series.points.begin(), series.points.end());
    chart.series.push_back(std::move(series));
  }
  if (time) chart.series.push_back({"Pareto front", pareto_front(all), false, true});
  return chart;
}

StudyChart condition_chart(const Figures& figures, const std::vector<std::string>& objects) {
  StudyChart chart{"Condition number of the paper's lights (its Fig. 3)",
                   "lights",
                   "median condition (λmax/λmin of GᵀG)",
                   {},
                   false,
                   true,
                   false};
  for (const std::string& object : objects) {
    StudySeries series{object, {}};
    for (const StudyFigure& f : figures) {
      if (f.object == object && f.method == "paper")
        series.points.emplace_back(f.lights, f.condition);
    }
    chart.series.push_back(std::move(series));
  }
  return chart;
}

/// Each material's mean error, sorted by the paper's: its Fig. 5.
StudyChart material_chart(const StoredStudy& study, const std::string& object, int lights) {
  std::map<std::string, std::map<std::string, std::pair<double, int>>> sums;  // method, material
  for (const StudyRow& row : study.rows) {
    if (row.object != object || (row.lights != lights && row.lights != 0)) continue;
    auto& [sum, n] = sums[row.method][row.material];
    sum += row.percent_log;
    ++n;
  }
  std::vector<std::pair<double, std::string>> order;
  const std::string by = sums.contains("paper") ? "paper" : sums.begin()->first;
  for (const auto& [material, s] : sums[by]) {
    order.emplace_back(s.first / s.second, material);
  }
  std::sort(order.begin(), order.end());
  StudyChart chart{
      fmt::format("{}: each material at {} lights (the paper's Fig. 5)", object, lights),
      fmt::format("test materials, by the error of {}", by),
      "error of ln f [%]",
      {},
      false,
      true,
      false};
  for (const std::string& method : study.identity.methods) {
    if (!sums.contains(method) || method.starts_with("random")) continue;
    // Between two materials of another order there is no line to follow.
    StudySeries series{method, {}, method != by, false, colour_of(study.identity, method)};
    for (std::size_t i = 0; i < order.size(); ++i) {
      const auto found = sums[method].find(order[i].second);
      if (found == sums[method].end()) continue;
      series.points.emplace_back(static_cast<double>(i + 1),
                                 found->second.first / found->second.second);
    }
    chart.series.push_back(std::move(series));
  }
  return chart;
}

/// 5 %, 50 % and 95 % of the true errors about each predicted one: of a twelfth of the rows each.
std::vector<StudySeries> band_of(const StoredStudy& study) {
  std::vector<std::pair<double, double>> pairs;
  for (const StudyRow& row : study.rows) {
    if (!std::isnan(row.predicted)) pairs.emplace_back(row.predicted, row.percent_log);
  }
  if (pairs.size() < 240) return {};
  std::sort(pairs.begin(), pairs.end());
  std::vector<StudySeries> out;
  for (const auto& [name, share] : {std::pair{"5 % of truths", 0.05}, std::pair{"half", 0.5},
                                    std::pair{"95 % of truths", 0.95}}) {
    StudySeries series{name, {}, false, true};
    for (std::size_t i = 0; i < 12; ++i) {
      const std::size_t first = i * pairs.size() / 12, last = (i + 1) * pairs.size() / 12;
      std::vector<double> truths;
      for (std::size_t j = first; j < last; ++j) truths.push_back(pairs[j].second);
      std::sort(truths.begin(), truths.end());
      series.points.emplace_back(
          pairs[(first + last) / 2].first,
          truths[static_cast<std::size_t>(share * static_cast<double>(truths.size() - 1))]);
    }
    out.push_back(std::move(series));
  }
  return out;
}

/// Predicted against true error; at most some thousand dots, every k-th row.
StudyChart calibration_chart(const StoredStudy& study) {
  StudyChart chart{"Predicted against true error, every material",
                   "predicted error [%]",
                   "true error [%]",
                   {},
                   true,
                   true,
                   true};
  std::size_t with = 0;
  for (const StudyRow& row : study.rows) with += !std::isnan(row.predicted);
  const std::size_t step = std::max<std::size_t>(1, with / 3000);
  std::map<std::string, StudySeries> series;
  std::size_t i = 0;
  for (const StudyRow& row : study.rows) {
    if (std::isnan(row.predicted) || i++ % step != 0) continue;
    StudySeries& s = series[row.method];
    s.name = row.method;
    s.markers_only = true;
    s.colour = colour_of(study.identity, row.method);
    s.points.emplace_back(row.predicted, row.percent_log);
  }
  for (const std::string& method : study.identity.methods) {
    if (series.contains(method)) chart.series.push_back(std::move(series[method]));
  }
  for (StudySeries& s : band_of(study)) chart.series.push_back(std::move(s));
  return chart;
}

/// How often the truth is inside the 90 % interval, by the number of lights.
StudyChart coverage_chart(const Figures& figures, const StudyIdentity& identity) {
  StudyChart chart{"How often the 90 % interval holds the true error",
                   "lights",
                   "share of materials, all objects [%]",
                   {},
                   false,
                   false,
                   false,
                   false};
  for (const std::string& method : identity.methods) {
    std::map<int, std::pair<double, double>> sums;
    for (const StudyFigure& f : figures) {
      if (f.method != method || std::isnan(f.coverage)) continue;
      auto& [inside, n] = sums[f.lights];
      inside += f.coverage * static_cast<double>(f.n);
      n += static_cast<double>(f.n);
    }
    if (sums.empty()) continue;
    StudySeries series{method, {}, false, false, colour_of(identity, method)};
    for (const auto& [lights, s] : sums) {
      series.points.emplace_back(lights, 100 * s.first / s.second);
    }
    chart.series.push_back(std::move(series));
  }
  if (chart.series.empty()) return chart;
  double most = 1;
  for (const StudySeries& s : chart.series) most = std::max(most, s.points.back().first);
  chart.series.push_back({"85 %", {{0, 85}, {most, 85}}, false, true});
  chart.series.push_back({"95 %", {{0, 95}, {most, 95}}, false, true});
  return chart;
}

std::string number(double x) { return std::isnan(x) ? "" : fmt::format("{:.3g}", x); }

std::string figure_table(const Figures& figures) {
  std::string html =
      "<div class=wide><table><tr><th>object<th>lights<th>method<th>mean %<th>median<th>sd of "
      "light sets<th>linear cos % mean<th>median<th>predicted %<th>truths in the 90 % interval, "
      "%<th>κ²";
  for (const StudyFigure& f : figures) {
    html += fmt::format(
        "<tr><td>{}<td>{}<td>{}<td>{:.2f}<td>{:.2f}<td>{:.2f}<td>{:.2f}<td>{:.2f}<td>{}<td>{}<td>{"
        "}",
        escaped(f.object), f.lights, f.method, f.mean, f.median, f.run_sd, f.linear_mean,
        f.linear_median, number(f.predicted), number(100 * f.coverage), number(f.condition));
  }
  return html + "</table></div>";
}

/// Pictures of the first split, a line per material.
std::string spheres_html(const StoredStudy& study) {
  if (study.spheres.empty()) return "";
  std::vector<MethodSpec> specs;
  for (const std::string& name : study.identity.methods) {
    if (Result<MethodSpec> spec = method_spec(name)) specs.push_back(*spec);
  }
  std::string columns = "the truth";
  for (const std::string& name : spheres_of(specs)) columns += ", " + name;
  std::string html = fmt::format(
      "<h2>Spheres under an environment light</h2><p>Four test materials of the first split from "
      "the dullest to the most shining, a "
      "line each; from left to right: {}. At the largest number of lights; every line has one "
      "exposure.</p><div class=spheres>",
      escaped(columns));
  for (const auto& [object, png] : study.spheres) {
    html += fmt::format(
        "<figure><img alt='spheres, lights of {0}' src='data:image/png;base64,{1}'><figcaption>"
        "{0}</figcaption></figure>",
        escaped(object), base64(png));
  }
  return html + "</div>";
}

std::string cost_table(const StoredStudy& study) {
  std::map<std::pair<std::string, std::string>, std::pair<double, int>> sums;
  double peak = 0;
  for (const CostRow& row : study.costs) {
    if (row.stage == "other") continue;
    auto& [sum, n] = sums[{row.object, row.stage}];
    sum += row.seconds;
    ++n;
    peak = std::max(peak, row.peak_mib);
  }
  std::string html = fmt::format(
      "<p>Wall seconds of this machine, as busy as it was. Peak memory of the process: {:.0f} "
      "MiB.</p><div class=wide><table><tr><th>object<th>mean s<th>stage (per split, all lights, "
      "light sets and materials)",
      peak);
  for (const auto& [key, s] : sums) {
    html += fmt::format("<tr><td>{}<td>{:.3f}<td>{}", escaped(key.first), s.first / s.second,
                        escaped(key.second));
  }
  return html + "</table></div>";
}

}  // namespace

std::string study_html(const StoredStudy& study) {
  const Figures figures = study_figures(study);
  const StudyIdentity& id = study.identity;
  std::string html =
      "<!doctype html><meta charset=utf-8><meta name=viewport "
      "content='width=device-width'><title>lightrig study</title>" +
      std::string(style) + "<h1>Error against run time</h1>";
  html += fmt::format(
      "<p>{} objects × {} splits of the materials ({}). Error is 100·‖ln f̂ − ln f‖/‖ln f‖ over the "
      "bivariate grid and channels, f in 1/sr; beside it the linear cosine-weighted error. Rig "
      "time is {}. Medians are over test materials, splits and light sets; random "
      "lights with the pseudo-inverse are heavy-tailed.</p>",
      id.objects.size(), id.splits,
      id.materials == "builtin"
          ? "built-in set"
          : "MERL-format files; where these are fits, errors are on fits of MERL",
      id.rig.empty() ? fmt::format("taken to be {:g} s per light", id.seconds_per_light)
                     : fmt::format("what the motion model of rig “{}” predicts", escaped(id.rig)));
  html += "<ul class=soft>";
  for (const StudyMethod& m : study_methods()) {
    if (std::find(id.methods.begin(), id.methods.end(), m.name) == id.methods.end()) continue;
    html += fmt::format("<li><b>{}</b>: {}", m.name, escaped(m.description));
  }
  html += "</ul><div class=charts>";
  for (const std::string& object : id.objects) {
    html += to_svg(error_chart(figures, id, object, false));
    html += to_svg(error_chart(figures, id, object, true));
  }
  const bool paper = std::any_of(figures.begin(), figures.end(),
                                 [](const StudyFigure& f) { return f.method == "paper"; });
  if (paper) html += to_svg(condition_chart(figures, id.objects));
  for (std::size_t i = 0; i < id.objects.size() && !study.rows.empty(); ++i) {
    if (!id.lights[i].empty()) {
      html += to_svg(material_chart(study, id.objects[i], id.lights[i].back()));
    }
  }
  html += to_svg(calibration_chart(study)) + to_svg(coverage_chart(figures, id)) + "</div>";
  html += spheres_html(study);
  html += "<h2>Figures</h2>" + figure_table(figures);
  html += "<h2>As printed</h2><div class=wide><pre>" + escaped(study_text(study)) + "</pre></div>";
  html += "<h2>What it cost here</h2>" + cost_table(study);
  html += "<h2>What was studied</h2><pre>" + escaped(id.text) + "</pre>";
  return html;
}

}  // namespace lightrig
