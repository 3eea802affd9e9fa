#include <algorithm>
#include <cmath>
#include <map>
#include <numeric>
#include <tuple>

#include "study/report.h"

namespace lightrig {
namespace {

double mean_of(const std::vector<double>& x) {
  return x.empty() ? std::nan("")
                   : std::accumulate(x.begin(), x.end(), 0.0) / static_cast<double>(x.size());
}

double median_of(std::vector<double> x) {
  if (x.empty()) return std::nan("");
  std::sort(x.begin(), x.end());
  const std::size_t half = x.size() / 2;
  return x.size() % 2 == 1 ? x[half] : (x[half - 1] + x[half]) / 2;
}

double deviation_of(const std::vector<double>& x) {
  if (x.size() < 2) return 0;
  const double mean = mean_of(x);
  double squares = 0;
  for (const double v : x) squares += (v - mean) * (v - mean);
  return std::sqrt(squares / static_cast<double>(x.size() - 1));
}

struct Gathered {
  std::vector<double> log, linear, predicted, condition, capture;
  std::map<std::pair<int, int>, std::vector<double>> by_set;  // (split, run)
  int inside = 0, with_interval = 0;
};

}  // namespace

std::vector<StudyFigure> study_figures(const StoredStudy& study) {
  std::map<std::tuple<std::string, int, std::string>, Gathered> groups;
  for (const StudyRow& row : study.rows) {
    Gathered& g = groups[{row.object, row.lights, row.method}];
    g.log.push_back(row.percent_log);
    g.linear.push_back(row.percent_linear_cos);
    g.by_set[{row.split, row.run}].push_back(row.percent_log);
    if (!std::isnan(row.capture_s)) g.capture.push_back(row.capture_s);
    if (!std::isnan(row.condition)) g.condition.push_back(row.condition);
    if (std::isnan(row.predicted)) continue;
    g.predicted.push_back(row.predicted);
    ++g.with_interval;
    g.inside += row.percent_log >= row.predicted_low && row.percent_log <= row.predicted_high;
  }
  std::vector<StudyFigure> figures;
  for (const auto& [key, g] : groups) {
    StudyFigure f;
    f.object = std::get<0>(key);
    f.lights = std::get<1>(key);
    f.method = std::get<2>(key);
    f.n = g.log.size();
    f.mean = mean_of(g.log);
    f.median = median_of(g.log);
    std::vector<double> set_means;
    for (const auto& [set, errors] : g.by_set) set_means.push_back(mean_of(errors));
    f.run_sd = deviation_of(set_means);
    f.linear_mean = mean_of(g.linear);
    f.linear_median = median_of(g.linear);
    f.predicted = mean_of(g.predicted);
    f.coverage =
        g.with_interval > 0 ? static_cast<double>(g.inside) / g.with_interval : std::nan("");
    f.condition = median_of(g.condition);
    f.minutes = g.capture.empty() ? f.lights * study.identity.seconds_per_light / 60
                                  : mean_of(g.capture) / 60;
    figures.push_back(f);
  }
  return figures;
}

std::vector<std::pair<double, double>> pareto_front(std::vector<std::pair<double, double>> points) {
  std::sort(points.begin(), points.end());
  std::vector<std::pair<double, double>> front;
  for (const auto& point : points) {
    if (front.empty() || point.second < front.back().second) front.push_back(point);
  }
  return front;
}

}  // namespace lightrig
