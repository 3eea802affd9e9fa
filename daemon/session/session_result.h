#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "core/fit.h"
#include "core/planner.h"
#include "core/samples.h"
#include "daemon/session/baselines.h"
#include "daemon/session/held_out.h"
#include "daemon/session/left_out.h"
#include "daemon/session/reduction.h"

namespace lightrig {

/// What came of one light.
struct LightResult {
  CapturedShot shot;
  LightPosition light;
  bool planned = true;                 ///< found in the plan
  double condition = 0;                ///< κ² planned with all lights so far; 0: none
  double predicted_error_percent = 0;  ///< planned; 0 for a held-out light
  std::int64_t rows_value = 0, rows_censored = 0;
  int new_cells = 0;          ///< cells no earlier light had shown
  double misfit_percent = 0;  ///< bins of this light: result against measured
  ExtractionStatistics statistics;
};

/// Lights that took the place of others while the session was captured.
struct ReplanNote {
  std::string reason;                       ///< the light that lost rows, and how
  std::vector<std::string> lights;          ///< their names
  double planned_percent = 0, percent = 0;  ///< predicted error as planned, and with these
};

/// What as many lights, or none, would have given.
struct Baselines {
  double mean_only_percent = 0;
  bool mean_only_is_true = false;  ///< against the reference; else predicted
  std::optional<RandomLights> random_lights;
};

/// Everything a finished reduction knows; result.json and report.html are two ways of writing it.
struct SessionResult {
  std::string session, rig, sample_id, operator_name, notes, state;
  std::string object;  ///< one line: what was in front of the camera

  std::string estimator, mapping, basis_source, plan_stop, stop_fired, arithmetic;
  Criterion criterion = Criterion::condition;  ///< of the plan
  double floor = 0;                            ///< [1/sr]
  double model_sigma = 0;                      ///< mapped units, as fitted with
  double expected_sigma = 0;                   ///< the same as the basis came with
  double variance_captured = 0;
  int basis_materials = 0, components = 0, channels = 0;
  int threads = 1;
  bool absolute_scale = false;
  CalibrationMark white, lens;  ///< the files that scale and lens were taken from

  std::vector<CurvePoint> curve;
  std::optional<HeldOutError> held_out;
  std::optional<BrdfError> true_error;
  std::string reference;  ///< what the true error is against
  Baselines baselines;
  std::vector<LightResult> lights;
  std::vector<ReplanNote> replans;
  std::vector<LeftOutLine> left_out;
  std::vector<std::string> drivers_not_opened;
  std::vector<StageCost> capture_cost;  ///< on the rig
  std::vector<StageCost> cost;          ///< of planning and reduction
  std::vector<std::string> warnings;

  BrdfBasis const* basis = nullptr;  ///< outlives the result
  Coefficients coefficients;
  Reconstruction reconstruction;
};

/// Whether the scale is absolute, and by what.
std::string scale_in_words(const SessionResult& result);

/// result.json, schema lightrig.result/1. Measured times stand in `cost` and `curve[].elapsed_s`
/// alone.
std::string result_json(const SessionResult& result);

/// coefficients.json, schema lightrig.coefficients/1: c, standard deviations, and what they are
/// coefficients of.
std::string coefficients_json(const SessionResult& result);

}  // namespace lightrig
