#pragma once

#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace lightrig {

/// One line of study.csv: one test material, reconstructed from one set of lights by one method.
struct StudyRow {
  std::string object;
  int split = 0;
  std::string method;
  int run = 0;  ///< which random light set; 0 otherwise
  int lights = 0;
  std::string material;
  double percent_log = 0, percent_linear_cos = 0, median_abs_log = 0;
  double predicted = 0, predicted_low = 0, predicted_high = 0;  ///< [%]; NaN: method makes none
  double condition = 0;  ///< κ² of the paper's basis, or of its first k components where condition
                         ///< numbers over so many chose; ∞ kept; NaN: random lights, or none
  double capture_s = 0;  ///< [s] predicted on the given rig; NaN without one
};

/// One line of cost.csv: measured, so never compared.
struct CostRow {
  std::string object;
  int split = 0;
  std::string stage;
  double seconds = 0;
  double peak_mib = 0;  ///< [MiB] largest memory of the process so far, every thread's job together
};

std::string study_header();
std::string to_csv(const StudyRow& row);
std::optional<StudyRow> study_row_from_csv(std::string_view line);
std::string cost_header();
std::string to_csv(const CostRow& row);
std::optional<CostRow> cost_row_from_csv(std::string_view line);

}  // namespace lightrig
