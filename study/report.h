#pragma once

#include <string>
#include <vector>

#include "study/store.h"

namespace lightrig {

/// Figures of one method at one number of lights on one object, over splits, runs and materials.
struct StudyFigure {
  std::string object, method;
  int lights = 0;
  std::size_t n = 0;            ///< rows
  double mean = 0, median = 0;  ///< percent_log
  double run_sd = 0;            ///< standard deviation of the means of single light sets
  double linear_mean = 0, linear_median = 0;  ///< percent_linear_cos
  double predicted = 0;                       ///< mean; NaN where the method makes none
  double coverage = 0;   ///< fraction of materials whose true error is inside the 90 % interval
  double condition = 0;  ///< median κ²
  double minutes = 0;    ///< mean predicted capture time, of the given rig or the assumed seconds
};
std::vector<StudyFigure> study_figures(const StoredStudy& study);

/// The readable table, and Table 1 beside the paper's where its objects are there.
std::string study_text(const StoredStudy& study);

/// A self-contained page: tables and plots as SVG, readable in print and in the dark.
std::string study_html(const StoredStudy& study);

/// Points that no other beats in both time and error, by time: what is worth its minutes.
std::vector<std::pair<double, double>> pareto_front(std::vector<std::pair<double, double>> points);

/// A line chart.
struct StudySeries {
  std::string name;
  std::vector<std::pair<double, double>> points;
  bool markers_only = false;
  bool dashed = false;  ///< a broken line in the colour of the text, without markers
  int colour = -1;      ///< number of the colour, of nine; −1: the place among the series
};
struct StudyChart {
  std::string title, x_label, y_label;
  std::vector<StudySeries> series;
  bool log_x = false, log_y = false;
  bool diagonal = false;    ///< draw y = x
  bool y_from_zero = true;  ///< where y is no logarithm
};
std::string to_svg(const StudyChart& chart);

}  // namespace lightrig
