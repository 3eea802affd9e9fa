#include "daemon/session/chart.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>

namespace lightrig {
namespace {

constexpr double left = 58, right = 176, top = 14, bottom = 46, label_height = 17;

struct Frame2d {
  double x0 = 0, x1 = 1;         ///< data
  double ln_y0 = 0, ln_y1 = 1;   ///< data, ln
  double width = 0, height = 0;  ///< of the whole picture [px]

  double x(double value) const { return left + (value - x0) / (x1 - x0) * (width - left - right); }
  double y(double value) const {
    return top + (ln_y1 - std::log(value)) / (ln_y1 - ln_y0) * (height - top - bottom);
  }
};

bool drawable(double x, double y) { return std::isfinite(x) && std::isfinite(y) && y > 0; }

// 1, 2 or 5 times a power of ten: the step that gives about `wanted` ticks.
double tick_step(double range, int wanted) {
  const double rough = range / wanted;
  const double power = std::pow(10, std::floor(std::log10(rough)));
  for (const double factor : {1.0, 2.0, 5.0}) {
    if (factor * power >= rough) return factor * power;
  }
  return 10 * power;
}

// Range of everything drawn, y widened to at least a factor of four.
Frame2d frame_of(const Chart& chart, int width, int height) {
  double x1 = 0, low = std::numeric_limits<double>::infinity(), high = 0;
  const auto see = [&](double x, double y) {
    if (!drawable(x, y)) return;
    x1 = std::max(x1, x);
    low = std::min(low, y);
    high = std::max(high, y);
  };
  for (const ChartLine& line : chart.lines) {
    for (const Eigen::Vector2d& p : line.points) see(p.x(), p.y());
  }
  for (const ChartBand& band : chart.bands) {
    for (const Eigen::Vector3d& p : band.points) {
      see(p.x(), p.y());
      see(p.x(), p.z());
    }
  }
  for (const ChartLevel& level : chart.levels) see(0, level.y);
  if (!(high > 0)) low = high = 1;
  if (!(x1 > 0)) x1 = 1;
  const double widen = std::max(1.15, std::sqrt(std::max(1.0, 4 * low / high)));
  return {0,
          1.03 * x1,
          std::log(low / widen),
          std::log(high * widen),
          static_cast<double>(width),
          static_cast<double>(height)};
}

std::string axes(const Chart& chart, const Frame2d& frame) {
  std::string svg;
  const double x_right = frame.width - right, y_bottom = frame.height - bottom;
  for (int decade = -6; decade <= 8; ++decade) {
    for (const double factor : {1.0, 2.0, 5.0}) {
      const double value = factor * std::pow(10, decade);
      const double y = frame.y(value);
      if (y < top || y > y_bottom) continue;
      svg +=
          fmt::format(R"(<line class="grid" x1="{0:.1f}" x2="{1:.1f}" y1="{2:.1f}" y2="{2:.1f}"/>)"
                      R"(<text class="axis" x="{3:.1f}" y="{4:.1f}" text-anchor="end">{5:g}</text>)"
                      "\n",
                      left, x_right, y, left - 8, y + 4, value);
    }
  }
  const double step = tick_step(frame.x1 - frame.x0, 6);
  for (int i = 0; i * step <= frame.x1; ++i) {
    const double x = frame.x(i * step);
    svg += fmt::format(
        R"(<line class="grid" x1="{0:.1f}" x2="{0:.1f}" y1="{1:.1f}" y2="{2:.1f}"/>)"
        R"(<text class="axis" x="{0:.1f}" y="{3:.1f}" text-anchor="middle">{4:g}</text>)"
        "\n",
        x, top, y_bottom, y_bottom + 18, i * step);
  }
  svg += fmt::format(R"(<text class="axis" x="{:.1f}" y="{:.1f}" text-anchor="middle">{}</text>)",
                     (left + x_right) / 2, frame.height - 8, escaped(chart.x_label));
  svg += fmt::format(
      R"svg(<text class="axis" transform="translate(14 {:.1f}) rotate(-90)" text-anchor="middle">{}</text>)svg"
      "\n",
      (top + y_bottom) / 2, escaped(chart.y_label));
  return svg;
}

std::string band_path(const ChartBand& band, const Frame2d& frame) {
  std::string there, back;
  for (const Eigen::Vector3d& p : band.points) {
    if (!drawable(p.x(), p.y()) || !drawable(p.x(), p.z())) continue;
    there +=
        fmt::format("{}{:.1f} {:.1f}", there.empty() ? "M" : "L", frame.x(p.x()), frame.y(p.z()));
    back = fmt::format("L{:.1f} {:.1f}", frame.x(p.x()), frame.y(p.y())) + back;
  }
  if (there.empty()) return "";
  return fmt::format("<path class=\"{}\" d=\"{}{}Z\"/>\n", band.style, there, back);
}

std::string line_path(const ChartLine& line, const Frame2d& frame) {
  std::string path, dots;
  for (const Eigen::Vector2d& p : line.points) {
    if (!drawable(p.x(), p.y())) continue;
    const double x = frame.x(p.x()), y = frame.y(p.y());
    path += fmt::format("{}{:.1f} {:.1f}", path.empty() ? "M" : "L", x, y);
    dots +=
        fmt::format("<circle class=\"{}\" cx=\"{:.1f}\" cy=\"{:.1f}\" r=\"3\"/>", line.style, x, y);
  }
  if (path.empty()) return "";
  return fmt::format("<path class=\"{}\" d=\"{}\"/>{}\n", line.style, path, dots);
}

struct Label {
  std::string name, style;
  double y = 0;  ///< [px] wished, then moved
};

// Names at the right edge, as near to their lines as they can stand without touching.
std::string labels(const Chart& chart, const Frame2d& frame) {
  std::vector<Label> names;
  for (const ChartLine& line : chart.lines) {
    for (auto p = line.points.rbegin(); p != line.points.rend(); ++p) {
      if (!drawable(p->x(), p->y())) continue;
      names.push_back({line.name, line.style, frame.y(p->y())});
      break;
    }
  }
  for (const ChartLevel& level : chart.levels) {
    if (drawable(0, level.y)) names.push_back({level.name, level.style, frame.y(level.y)});
  }
  std::stable_sort(names.begin(), names.end(),
                   [](const Label& a, const Label& b) { return a.y < b.y; });
  for (std::size_t i = 1; i < names.size(); ++i) {
    names[i].y = std::max(names[i].y, names[i - 1].y + label_height);
  }
  double limit = frame.height - bottom;
  for (auto label = names.rbegin(); label != names.rend(); ++label) {
    label->y = std::min(label->y, limit);
    limit = label->y - label_height;
  }
  std::string svg;
  for (const Label& label : names) {
    svg += fmt::format("<text class=\"label {}\" x=\"{:.1f}\" y=\"{:.1f}\">{}</text>\n",
                       label.style, frame.width - right + 8, label.y + 4, escaped(label.name));
  }
  return svg;
}

}  // namespace

std::string escaped(const std::string& text) {
  std::string safe;
  safe.reserve(text.size());
  for (const char c : text) {
    switch (c) {
      case '&':
        safe += "&amp;";
        break;
      case '<':
        safe += "&lt;";
        break;
      case '>':
        safe += "&gt;";
        break;
      case '"':
        safe += "&quot;";
        break;
      default:
        safe += c;
    }
  }
  return safe;
}

std::string to_svg(const Chart& chart, int width, int height) {
  const Frame2d frame = frame_of(chart, width, height);
  std::string svg =
      fmt::format("<svg class=\"chart\" viewBox=\"0 0 {} {}\" role=\"img\" aria-label=\"{}\">\n",
                  width, height, escaped(chart.title));
  svg += axes(chart, frame);
  for (const ChartBand& band : chart.bands) svg += band_path(band, frame);
  for (const ChartLevel& level : chart.levels) {
    if (!drawable(0, level.y)) continue;
    svg += fmt::format(
        "<line class=\"{}\" x1=\"{:.1f}\" x2=\"{:.1f}\" y1=\"{:.1f}\" y2=\"{:.1f}\"/>\n",
        level.style, left, frame.width - right, frame.y(level.y), frame.y(level.y));
  }
  for (const ChartLine& line : chart.lines) svg += line_path(line, frame);
  return svg + labels(chart, frame) + "</svg>\n";
}

}  // namespace lightrig
