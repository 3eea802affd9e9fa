#include "study/spheres.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "daemon/session/frame_file.h"
#include "daemon/session/sphere_view.h"
#include "study/job.h"

namespace lightrig {
namespace {

constexpr int diameter = 88, gap = 6;  // [px]
constexpr std::size_t lines = 4;

/// Pictures below each other, left edges aligned.
Picture below(const std::vector<Picture>& pictures) {
  Picture out;
  for (const Picture& p : pictures) {
    out.width = std::max(out.width, p.width);
    out.height += p.height + (out.height > 0 ? gap : 0);
  }
  out.rgba.assign(static_cast<std::size_t>(out.width) * static_cast<std::size_t>(out.height) * 4,
                  0);
  std::size_t top = 0;
  for (const Picture& p : pictures) {
    const std::size_t stride = static_cast<std::size_t>(p.width) * 4;
    for (std::size_t y = 0; y < static_cast<std::size_t>(p.height); ++y) {
      const auto from = p.rgba.begin() + static_cast<std::ptrdiff_t>(y * stride);
      std::copy(from, from + static_cast<std::ptrdiff_t>(stride),
                out.rgba.begin() + static_cast<std::ptrdiff_t>(
                                       (top + y) * static_cast<std::size_t>(out.width) * 4));
    }
    top += static_cast<std::size_t>(p.height + gap);
  }
  return out;
}

/// Test materials from the dullest to the most shining: f at θh = 0 against its median.
std::vector<std::size_t> by_shine(std::span<const Material> test) {
  std::vector<std::pair<double, std::size_t>> shine;
  for (std::size_t m = 0; m < test.size(); ++m) {
    const BrdfTable& table = test[m].table;
    std::vector<double> values;
    double peak = 0;
    for (int cell = 0; cell < table.grid.cells(); ++cell) {
      const double f = table.f.row(cell).mean();
      if (!std::isfinite(f)) continue;
      values.push_back(f);
      if (table.grid.row_h(cell) == 0) peak = std::max(peak, f);
    }
    const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
    std::nth_element(values.begin(), middle, values.end());
    shine.emplace_back(peak / std::max(*middle, 1e-12), m);
  }
  std::sort(shine.begin(), shine.end());
  std::vector<std::size_t> order;
  for (const auto& [value, m] : shine) order.push_back(m);
  return order;
}

}  // namespace

std::vector<std::string> spheres_of(std::span<const MethodSpec> methods) {
  std::vector<std::string> out;
  for (const char* name : {"random", "paper", "paper-map", "a-optimal-map"}) {
    const bool there = std::any_of(methods.begin(), methods.end(),
                                   [&](const MethodSpec& m) { return m.name == name; });
    if (there) out.emplace_back(name);
  }
  if (!out.empty()) return out;
  for (const MethodSpec& m : methods) {
    if (m.lights != MethodSpec::Lights::none && out.size() < 4) out.push_back(m.name);
  }
  return out;
}

std::vector<std::byte> draw_spheres(
    std::span<const Material> test, const std::vector<std::string>& methods,
    const std::map<std::string, std::vector<BrdfTable>>& estimates) {
  if (estimates.empty()) return {};
  std::vector<const BrdfTable*> tables;
  std::size_t columns = 0;
  const std::size_t shown = std::min(lines, test.size());
  const std::vector<std::size_t> order = by_shine(test);
  for (std::size_t line = 0; line < shown; ++line) {
    const std::size_t m = shown == 1 ? order[0] : order[line * (test.size() - 1) / (shown - 1)];
    const std::size_t before = tables.size();
    tables.push_back(&test[m].table);
    for (const std::string& method : methods) {
      const auto found = estimates.find(method);
      if (found != estimates.end()) tables.push_back(&found->second[m]);
    }
    columns = tables.size() - before;
  }
  const std::vector<LinearImage> images = render_spheres(tables, studio_environment(), diameter, 1);
  std::vector<Picture> rows;
  for (std::size_t first = 0; first < images.size(); first += columns) {
    const ToneMapping tone = choose_tone(images[first]);
    std::vector<Picture> row;
    for (std::size_t i = first; i < first + columns; ++i) {
      row.push_back(tone_mapped(images[i], tone));
    }
    rows.push_back(beside(row, gap));
  }
  const Picture all = below(rows);
  const Result<std::vector<std::byte>> png = encode_png(all.width, all.height, 4, all.rgba);
  return png ? *png : std::vector<std::byte>{};
}

}  // namespace lightrig
