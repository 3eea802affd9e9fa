#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "core/candidate_bins.h"
#include "core/gantry_model.h"
#include "core/planner.h"

namespace lightrig {

/// One light of a session.
struct Shot {
  int candidate = -1;
  LightPosition light;
  GantryPosition gantry;
  std::vector<double> exposures;  ///< [s] on offer, shortest first
  SelectedLight selection;
  bool held_out = false;  ///< captured, never fitted
};

/// What the scene did not need, counted.
struct LeftOut {
  BinningStatistics binning;
  SelectionStatistics selection;
  int candidates_offered = 0;
  int candidates_unreachable = 0;  ///< outside the gantry's travel
  int candidates_kept_out = 0;     ///< for any of the reasons below
  int candidates_touching = 0;     ///< lamp or arm would touch something
  int candidates_in_view = 0;      ///< the lamp would show in the picture
  int candidates_into_lens = 0;    ///< it would shine into the lens
  int candidates_hiding = 0;       ///< lamp or arm would stand before the object
  int lights_not_needed = 0;       ///< max_lights − chosen
  int components_available = 0, components_used = 0;
  int channels_not_needed = 0;  ///< 2 for a mono camera
  std::vector<std::string> drivers_not_opened;
};

/// SHA-256 of what a stored plan was made from, in hexadecimal; "" where it names none.
struct PlanInputs {
  std::string rig, session;     ///< of the files' bytes
  std::string mesh, materials;  ///< of what was loaded
};

/// A light set and the way to it, computed before anything moves.
struct Plan {
  Criterion criterion = Criterion::condition;
  StopRule stop = StopRule::plateau;
  double stop_value = 0;
  std::vector<Shot> shots;       ///< in order of selection; held-out ones last
  std::vector<int> visit_order;  ///< indices into shots
  double mean_only_error_percent = 0;
  double predicted_capture_time = 0;  ///< [s]
  LeftOut left_out;
  PlanInputs inputs;  ///< of a stored plan; empty for one just made
};

}  // namespace lightrig
