#pragma once

#include <optional>
#include <span>
#include <string>
#include <vector>

#include "core/result.h"
#include "study/study.h"

namespace lightrig {

/// One way of choosing lights and of fitting what they show.
struct MethodSpec {
  enum class Lights : std::uint8_t { none, condition, a_optimal, random };
  enum class Fit : std::uint8_t { mean, bivariate, all_samples, pseudo_inverse, map };
  std::string name;
  Lights lights = Lights::none;
  bool pixels = false;  ///< pixels with interpolated normals, else the paper's vertices
  Fit fit = Fit::map;
  std::string prior;   ///< of MAP: "" channels as columns and ln max(f, floor), else "stacked",
                       ///< "ln-offset" or "log-relative"
  int components = 0;  ///< of planning and fit; 0: what is usual for the method
  int exposures = -1;  ///< as StudyOptions::exposures; −1 takes those
  /// Exponents clipped to the training range itself, not to what unseen materials need of it.
  bool bare_range = false;
};

/// A method by its name: one of study_methods(), or LIGHTS:POINTS:ESTIMATOR with LIGHTS one of
/// condition, a-optimal, random, POINTS vertices or pixels, ESTIMATOR pseudo-inverse, map,
/// map-stacked, map-ln-offset or map-log-relative, and then, if wanted, :k=N, :exposures=N and
/// :range=bare.
/// Errors: invalid_input.
Result<MethodSpec> method_spec(const std::string& name);

/// The methods that options ask for, in their order: the named ones (all where none is named and no
/// axis is given) and the product of the axes.
Result<std::vector<MethodSpec>> methods_of(const StudyOptions& options);

}  // namespace lightrig
