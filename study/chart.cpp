#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>

#include "study/report.h"

namespace lightrig {
namespace {

constexpr double width = 640, height = 400, left = 64, right = 170, top = 34, bottom = 48;  // [px]
/// Okabe and Ito's colours and two more: told apart by every kind of colour vision.
constexpr std::array<const char*, 9> colours = {"#0072b2", "#d55e00", "#009e73",
                                                "#cc79a7", "#e69f00", "#56b4e9",
                                                "#999999", "#b8a800", "#aa4466"};
/// Many dots stand so close that they must be small.
constexpr std::size_t many = 300;

/// One axis: data to pixels.
struct Scale {
  double low = 0, high = 1, from = 0, to = 1;
  bool log = false;
  double value(double x) const { return log ? std::log10(x) : x; }
  double operator()(double x) const {
    return from + (value(x) - value(low)) / (value(high) - value(low)) * (to - from);
  }
};

bool drawable(double x, bool log) { return std::isfinite(x) && (!log || x > 0); }

Scale fit_scale(const StudyChart& chart, bool x_axis) {
  const bool log = x_axis ? chart.log_x : chart.log_y;
  double low = HUGE_VAL, high = -HUGE_VAL;
  for (const StudySeries& s : chart.series) {
    for (const auto& [x, y] : s.points) {
      const double v = x_axis ? x : y;
      if (!drawable(v, log)) continue;
      low = std::min(low, v);
      high = std::max(high, v);
    }
  }
  if (!(low <= high)) low = 1, high = 10;
  // An axis that begins far from its first point shows little else.
  const bool far = x_axis && low > 0.4 * high;
  if (!log && far) low -= 0.25 * (high - low);
  if (!log && !far && (x_axis || chart.y_from_zero)) low = std::min(low, 0.0);
  if (!log && !x_axis && !chart.y_from_zero) low -= 0.1 * (high - low);
  if (high <= low) high = log ? low * 10 : low + 1;
  if (log) low /= 1.1, high *= 1.1;
  if (!log) high += 0.04 * (high - low);
  return x_axis ? Scale{low, high, left, width - right, log}
                : Scale{low, high, height - bottom, top, log};
}

std::vector<double> ticks(const Scale& scale, bool whole = false) {
  std::vector<double> out;
  if (scale.log) {
    for (double decade = std::pow(10, std::floor(std::log10(scale.low))); decade <= scale.high;
         decade *= 10) {
      for (const double step : {1.0, 2.0, 5.0}) {
        const double t = decade * step;
        const bool dense = scale.high / scale.low > 1e3 && step > 1;
        if (t >= scale.low && t <= scale.high && !dense) out.push_back(t);
      }
    }
    return out;
  }
  const double raw = (scale.high - scale.low) / 6;
  const double power = std::pow(10, std::floor(std::log10(raw)));
  const double fine = power * (raw / power < 2 ? 2 : raw / power < 5 ? 5 : 10);
  const double step = whole ? std::max(fine, 1.0) : fine;
  for (double t = std::ceil(scale.low / step) * step; t <= scale.high; t += step) out.push_back(t);
  return out;
}

std::string axes(const StudyChart& chart, const Scale& x, const Scale& y) {
  std::string svg;
  for (const double t : ticks(x, chart.x_label == "lights")) {
    svg += fmt::format(
        "<line class=g x1='{0:.1f}' x2='{0:.1f}' y1='{1}' y2='{2}' /><text x='{0:.1f}' y='{3}' "
        "text-anchor=middle>{4:g}</text>",
        x(t), top, height - bottom, height - bottom + 16, t);
  }
  for (const double t : ticks(y)) {
    svg += fmt::format(
        "<line class=g x1='{1}' x2='{2}' y1='{0:.1f}' y2='{0:.1f}' /><text x='{3}' y='{4:.1f}' "
        "text-anchor=end>{5:g}</text>",
        y(t), left, width - right, left - 6, y(t) + 4, t);
  }
  svg += fmt::format("<text class=t x='{}' y=20>{}</text>", left, chart.title);
  svg += fmt::format("<text x='{}' y='{}' text-anchor=middle>{}</text>", (left + width - right) / 2,
                     height - 12, chart.x_label);
  svg += fmt::format("<text transform='translate(16 {}) rotate(-90)' text-anchor=middle>{}</text>",
                     (top + height - bottom) / 2, chart.y_label);
  return svg;
}

std::string series_svg(const StudySeries& s, const char* colour, const Scale& x, const Scale& y) {
  std::string path, dots;
  for (const auto& [px, py] : s.points) {
    if (!drawable(px, x.log) || !drawable(py, y.log)) continue;
    path += fmt::format("{}{:.1f} {:.1f}", path.empty() ? "M" : "L", x(px), y(py));
    dots += fmt::format("<circle cx='{:.1f}' cy='{:.1f}' r='{}' fill='{}' />", x(px), y(py),
                        !s.markers_only          ? 3.0
                        : s.points.size() > many ? 1.8
                                                 : 2.6,
                        colour);
  }
  if (s.dashed) {
    return fmt::format("<path class=d d='{}' fill=none stroke-width=1.5 />", path);
  }
  if (s.markers_only) return fmt::format("<g opacity=0.55>{}</g>", dots);
  return fmt::format("<path d='{}' fill=none stroke='{}' stroke-width=2 />{}", path, colour, dots);
}

}  // namespace

std::string to_svg(const StudyChart& chart) {
  Scale x = fit_scale(chart, true), y = fit_scale(chart, false);
  if (chart.diagonal) {
    x.low = y.low = std::min(x.low, y.low);
    x.high = y.high = std::max(x.high, y.high);
  }
  std::size_t longest = 0;
  for (const StudySeries& one : chart.series) longest = std::max(longest, one.name.size());
  const double legend = std::max(right, 36 + 7.0 * static_cast<double>(longest));  // [px]
  std::string svg = fmt::format("<svg viewBox='0 0 {} {}' role=img aria-label='{}'>",
                                width - right + legend, height, chart.title);
  svg += axes(chart, x, y);
  if (chart.diagonal) {
    svg += fmt::format("<line class=d x1='{:.1f}' y1='{:.1f}' x2='{:.1f}' y2='{:.1f}' />", x(x.low),
                       y(y.low), x(x.high), y(y.high));
  }
  for (std::size_t i = 0; i < chart.series.size(); ++i) {
    const int own = chart.series[i].colour;
    const char* colour = colours[(own < 0 ? i : static_cast<std::size_t>(own)) % colours.size()];
    svg += series_svg(chart.series[i], colour, x, y);
    const double at = top + 8 + 18 * static_cast<double>(i);
    if (chart.series[i].dashed) {
      svg += fmt::format(
          "<line class=d x1='{}' x2='{}' y1='{}' y2='{}' /><text x='{}' y='{}'>{}</text>",
          width - right + 10, width - right + 26, at + 6, at + 6, width - right + 30, at + 10,
          chart.series[i].name);
      continue;
    }
    svg += fmt::format(
        "<rect x='{}' y='{}' width=12 height=12 fill='{}' /><text x='{}' y='{}'>{}</text>",
        width - right + 12, at, colour, width - right + 30, at + 10, chart.series[i].name);
  }
  return svg + "</svg>";
}

}  // namespace lightrig
