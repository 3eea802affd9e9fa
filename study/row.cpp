#include "study/row.h"

#include <fmt/format.h>

#include <charconv>
#include <cmath>
#include <limits>

namespace lightrig {
namespace {

std::string number(double x) {
  if (std::isnan(x)) return "";
  return std::isinf(x) ? "inf" : fmt::format("{:.6g}", x);
}

std::vector<std::string_view> fields_of(std::string_view line) {
  std::vector<std::string_view> fields;
  while (true) {
    const std::size_t comma = line.find(',');
    fields.push_back(line.substr(0, comma));
    if (comma == std::string_view::npos) return fields;
    line.remove_prefix(comma + 1);
  }
}

std::optional<double> parse(std::string_view text) {
  if (text.empty()) return std::numeric_limits<double>::quiet_NaN();
  double x = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), x);
  if (error != std::errc() || end != text.data() + text.size()) return std::nullopt;
  return x;
}

}  // namespace

std::string study_header() {
  return "object,split,method,run,lights,material,percent_log,percent_linear_cos,median_abs_log,"
         "predicted,predicted_low,predicted_high,condition,capture_s\n";
}

std::string to_csv(const StudyRow& r) {
  return fmt::format("{},{},{},{},{},{},{},{},{},{},{},{},{},{}\n", r.object, r.split, r.method,
                     r.run, r.lights, r.material, number(r.percent_log),
                     number(r.percent_linear_cos), number(r.median_abs_log), number(r.predicted),
                     number(r.predicted_low), number(r.predicted_high), number(r.condition),
                     number(r.capture_s));
}

std::optional<StudyRow> study_row_from_csv(std::string_view line) {
  const std::vector<std::string_view> f = fields_of(line);
  if (f.size() != 14) return std::nullopt;
  std::vector<double> x;
  for (const std::size_t i : {1U, 3U, 4U, 6U, 7U, 8U, 9U, 10U, 11U, 12U, 13U}) {
    const std::optional<double> value = parse(f[i]);
    if (!value) return std::nullopt;
    x.push_back(*value);
  }
  return StudyRow{std::string(f[0]),
                  static_cast<int>(x[0]),
                  std::string(f[2]),
                  static_cast<int>(x[1]),
                  static_cast<int>(x[2]),
                  std::string(f[5]),
                  x[3],
                  x[4],
                  x[5],
                  x[6],
                  x[7],
                  x[8],
                  x[9],
                  x[10]};
}

std::string cost_header() { return "object,split,stage,seconds,peak_mib\n"; }

std::string to_csv(const CostRow& r) {
  return fmt::format("{},{},{},{},{}\n", r.object, r.split, r.stage, number(r.seconds),
                     number(r.peak_mib));
}

std::optional<CostRow> cost_row_from_csv(std::string_view line) {
  const std::vector<std::string_view> f = fields_of(line);
  if (f.size() != 5) return std::nullopt;
  const std::optional<double> split = parse(f[1]), seconds = parse(f[3]), peak = parse(f[4]);
  if (!split || !seconds || !peak) return std::nullopt;
  return CostRow{std::string(f[0]), static_cast<int>(*split), std::string(f[2]), *seconds, *peak};
}

}  // namespace lightrig
