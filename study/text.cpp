#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "study/report.h"

namespace lightrig {
namespace {

const StudyFigure* find(const std::vector<StudyFigure>& figures, const std::string& object,
                        const std::string& method, int lights) {
  for (const StudyFigure& f : figures) {
    if (f.object == object && f.method == method && f.lights == lights) return &f;
  }
  return nullptr;
}

std::string cell(double x) { return std::isnan(x) ? "-" : fmt::format("{:.2f}", x); }

/// The paper's Table 1 with our figures beside the printed ones.
std::string table1_text(const std::vector<StudyFigure>& figures) {
  std::string text = fmt::format(
      "\nTable 1 of Ali et al. 2013 beside ours; percentage error of ln f, mean over test "
      "materials "
      "and splits\n{:<13}{:>7} |{:>9}{:>9}{:>10}{:>10}{:>8} |{:>15} {:>22}{:>9}\n",
      "object", "lights", "printed", "ours", "+MAP", "A-opt+MAP", "mean", "random printed",
      "random ours mean+-sd", "median");
  for (const Table1Entry& entry : table1_entries()) {
    for (int i = 0; i < 2; ++i) {
      const int n = entry.lights[i];
      const StudyFigure* paper = find(figures, entry.object, "paper", n);
      if (paper == nullptr) continue;
      const auto mean = [&](const char* method, int lights) {
        const StudyFigure* f = find(figures, entry.object, method, lights);
        return f == nullptr ? std::nan("") : f->mean;
      };
      const StudyFigure* random = find(figures, entry.object, "random", n);
      text += fmt::format(
          "{:<13}{:>7} |{:>9.2f}{:>9.2f}{:>10}{:>10}{:>8} |{:>15} {:>22}{:>9}\n", entry.paper_name,
          n, entry.informed[i], paper->mean, cell(mean("paper-map", n)),
          cell(mean("a-optimal-map", n)), cell(mean("mean", 0)),
          fmt::format("{:.2f}+-{:.2f}", entry.random[i], entry.random_sd[i]),
          random == nullptr ? "-" : fmt::format("{:.2f}+-{:.2f}", random->mean, random->run_sd),
          random == nullptr ? "-" : fmt::format("{:.2f}", random->median));
    }
  }
  return text;
}

/// Median error and rig minutes at every number of lights: what each further minute buys.
std::string time_text(const StoredStudy& study, const std::vector<StudyFigure>& figures) {
  std::vector<std::string> methods;
  for (const std::string& name : study.identity.methods) {
    const bool lit = std::any_of(figures.begin(), figures.end(), [&](const StudyFigure& f) {
      return f.method == name && f.lights > 0;
    });
    if (lit) methods.push_back(name);
  }
  std::string text =
      fmt::format("\nError against run time: median % of ln f @ minutes ({})\n{:<13}{:>7}",
                  study.identity.rig.empty()
                      ? fmt::format("{:g} s a light assumed", study.identity.seconds_per_light)
                      : fmt::format("predicted on rig \"{}\"", study.identity.rig),
                  "object", "lights");
  for (const std::string& m : methods) text += fmt::format("  {:>16}", m);
  for (std::size_t i = 0; i < study.identity.objects.size(); ++i) {
    const std::string& object = study.identity.objects[i];
    for (const int n : study.identity.lights[i]) {
      text += fmt::format("\n{:<13}{:>7}", object, n);
      for (const std::string& m : methods) {
        const StudyFigure* f = find(figures, object, m, n);
        const std::string said =
            f == nullptr ? "-" : fmt::format("{:.2f} @ {:.2f}", f->median, f->minutes);
        text += fmt::format("  {:>{}}", said, std::max<std::size_t>(16, m.size()));
      }
    }
  }
  return text + "\n";
}

}  // namespace

std::string study_text(const StoredStudy& study) {
  const std::vector<StudyFigure> figures = study_figures(study);
  std::string text =
      fmt::format("{} of {} jobs; materials: {}{}\n", study.jobs_there, study.identity.jobs(),
                  study.identity.materials,
                  study.identity.materials == "builtin"
                      ? ""
                      : " (errors hold for what those files are; on fits of MERL say so)");
  std::size_t widest = 15;
  for (const StudyFigure& f : figures) widest = std::max(widest, f.method.size() + 1);
  text += fmt::format("{:<13}{:>7} {:<{}}{:>8}{:>8}{:>8}{:>12}{:>12}{:>11}{:>10}{:>12}\n", "object",
                      "lights", "method", widest, "mean %", "median", "sd", "lin cos %",
                      "lin median", "predicted", "coverage", "condition");
  for (const std::string& object : study.identity.objects) {
    for (const StudyFigure& f : figures) {
      if (f.object != object) continue;
      text += fmt::format(
          "{:<13}{:>7} {:<{}}{:>8.2f}{:>8.2f}{:>8.2f}{:>12.2f}{:>12.2f}{:>11}{:>10}{:>12}\n",
          f.object, f.lights, f.method, widest, f.mean, f.median, f.run_sd, f.linear_mean,
          f.linear_median, cell(f.predicted), cell(f.coverage),
          std::isnan(f.condition) ? "-" : fmt::format("{:.4g}", f.condition));
    }
  }
  text += time_text(study, figures);
  const bool has_table1 =
      std::any_of(table1_entries().begin(), table1_entries().end(), [&](const Table1Entry& e) {
        return find(figures, e.object, "paper", e.lights[0]) != nullptr;
      });
  if (has_table1) text += table1_text(figures);
  return text;
}

}  // namespace lightrig
