#pragma once

#include <Eigen/Core>
#include <string>
#include <vector>

namespace lightrig {

/// A line through points, named at its right end.
struct ChartLine {
  std::string name;
  std::string style;  ///< CSS class: colour and dashes come from the page's style sheet
  std::vector<Eigen::Vector2d> points;
};

/// What lies between two curves over the same x.
struct ChartBand {
  std::string style;
  std::vector<Eigen::Vector3d> points;  ///< x, low, high
};

/// A horizontal line across the whole chart, named at its right end.
struct ChartLevel {
  std::string name;
  std::string style;
  double y = 0;
};

/// A line chart with a logarithmic y axis: errors span two decades, and halving one should look the
/// same wherever it happens.
struct Chart {
  std::string title;  ///< read by screen readers
  std::string x_label, y_label;
  std::vector<ChartBand> bands;
  std::vector<ChartLine> lines;
  std::vector<ChartLevel> levels;
};

/// The chart as an <svg> element for a page that defines the classes `axis`, `grid`, `label` and
/// those of the lines. Values that are not finite and positive in y are left out.
std::string to_svg(const Chart& chart, int width, int height);

/// Text made safe for HTML and XML.
std::string escaped(const std::string& text);

}  // namespace lightrig
