#include "cli/left_out.h"

#include <fmt/format.h>

#include <vector>

#include "cli/say.h"

namespace lightrig::cli {
namespace {

std::string count(std::int64_t value) {
  // Groups of three: the counts go into the hundred millions.
  std::string digits = std::to_string(value);
  for (int at = static_cast<int>(digits.size()) - 3; at > 0; at -= 3)
    digits.insert(static_cast<std::size_t>(at), 1, ',');
  return digits;
}

}  // namespace

std::string left_out_table(const LeftOut& out) {
  const BinningStatistics& bins = out.binning;
  const SelectionStatistics& chosen = out.selection;
  std::vector<std::vector<std::string>> rows{
      {"surface points facing away or too oblique", count(bins.back_facing),
       count(bins.points_tested)},
      {"samples in a cell the light had filled", count(bins.repeated),
       count(bins.points_tested - bins.repeated)},
      {bins.convex ? "shadow rays (the object is convex)" : "shadow rays",
       count(bins.rays_left_out), count(bins.rays_cast)},
      {"candidates out of the gantry's travel", count(out.candidates_unreachable),
       count(out.candidates_offered - out.candidates_unreachable - out.candidates_kept_out)},
      {"candidates kept out or in the camera's way", count(out.candidates_kept_out), ""},
      {"candidates that see nothing", count(chosen.empty_candidates), ""},
      {"candidates alike in what they add", count(chosen.identical_candidates), ""},
      {"evaluations a bound made needless", count(chosen.bounded_away),
       count(chosen.exact_evaluations)},
      {"lights after the plateau", count(out.lights_not_needed), ""},
      {"basis components", count(out.components_available - out.components_used),
       count(out.components_used)},
      {"colour channels", count(out.channels_not_needed), count(3 - out.channels_not_needed)}};
  std::string text = table({"not needed by this scene", "left out", "used"}, rows);
  for (const std::string& driver : out.drivers_not_opened)
    text += fmt::format("driver not opened: {}\n", driver);
  return text;
}

}  // namespace lightrig::cli
