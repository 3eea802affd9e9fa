#include "daemon/session/left_out.h"

#include <algorithm>

namespace lightrig {

bool held_out_as_asked(const std::string& remark) { return remark.ends_with("held out, as asked"); }

std::vector<LeftOutLine> planned_left_out(const Prepared& prepared) {
  const LeftOut& out = prepared.plan.left_out;
  const BinningStatistics& bins = out.binning;
  const SelectionStatistics& chosen = out.selection;
  const std::int64_t pairs = bins.points_tested + bins.back_facing + bins.no_half_vector;
  const int candidates = out.candidates_offered;
  const auto lights = std::count_if(prepared.plan.shots.begin(), prepared.plan.shots.end(),
                                    [](const Shot& shot) { return !shot.held_out; });
  const auto held_out =
      std::count_if(prepared.remarks.begin(), prepared.remarks.end(), held_out_as_asked);
  std::vector<LeftOutLine> lines{
      {"shadow_rays", "shadow rays", bins.rays_left_out, bins.rays_left_out + bins.rays_cast,
       bins.convex ? "the object is convex: nothing can shade it"
                   : "their cell already had an unshadowed point"},
      {"back_facing", "point and light pairs", bins.back_facing, pairs,
       "the light is behind the surface, or too oblique"},
      {"no_half_vector", "pairs without a half vector", bins.no_half_vector, pairs,
       "light exactly behind the object"},
      {"repeated_bins", "repeated bins", bins.repeated, bins.points_tested,
       "the same light had filled the cell already"},
      {"candidates_unreachable", "candidates out of reach", out.candidates_unreachable, candidates,
       "beyond the gantry's travel"},
      {"candidates_touching", "candidates kept out", out.candidates_touching, candidates,
       "lamp or arm would touch something"},
      {"candidates_in_view", "candidates in the picture", out.candidates_in_view, candidates,
       "the camera would see the lamp"},
      {"candidates_into_lens", "candidates facing the lens", out.candidates_into_lens, candidates,
       "the lamp would shine into the lens"},
      {"candidates_hiding", "candidates before the object", out.candidates_hiding, candidates,
       "lamp or arm would hide part of the object"},
      {"candidates_empty", "candidates that show nothing", chosen.empty_candidates, candidates,
       "no visible point is lit from there"},
      {"identical_candidates", "candidates merged", chosen.identical_candidates, candidates,
       "they add the same cells as another"},
      {"exact_evaluations", "exact evaluations of the criterion", chosen.bounded_away,
       chosen.bounded_away + chosen.exact_evaluations, "a bound already showed a better candidate"},
      {"lights", "lights", out.lights_not_needed, out.lights_not_needed + lights,
       prepared.plan.stop == StopRule::count
           ? "no candidate left shows a cell that those chosen do not"
           : "the stopping rule found them not worth their time"},
      {"planning_components", "components while planning",
       out.components_available - out.components_used, out.components_available,
       "the criterion is steered by the first ones"},
      {"materials", "materials of the set", held_out, held_out + prepared.fit_basis.materials,
       "held out of the basis, as the session asks"},
      {"channels", "colour channels", out.channels_not_needed, 3,
       out.channels_not_needed > 0 ? "the camera is monochrome" : "all are used"}};
  for (LeftOutLine& line : lines) line.left_out = std::max<std::int64_t>(line.left_out, 0);
  return lines;
}

}  // namespace lightrig
