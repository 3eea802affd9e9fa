#pragma once

#include <cstddef>
#include <map>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "core/brdf_basis.h"
#include "core/brdf_table.h"
#include "core/result.h"
#include "study/method.h"
#include "study/rig_time.h"
#include "study/row.h"
#include "study/scene.h"
#include "study/study.h"

namespace lightrig {

/// One division of the materials with the bases of the part that may be learnt from.
struct StudySplit {
  int index = 0;
  std::vector<Material> test;
  BrdfBasis paper;                          ///< stacked channels, first K components
  BrdfBasis whole;                          ///< channels as columns, all components: MAP
  std::map<std::string, BrdfBasis> priors;  ///< MAP's others that a method names
  double seconds = 0;                       ///< [s] to make both
};
Result<StudySplit> make_split(std::span<const Material> materials, const StudyOptions& options,
                              std::span<const MethodSpec> methods, int index);

/// What one job gives.
struct JobResult {
  std::vector<StudyRow> rows;
  std::vector<CostRow> costs;
  /// PNG of the first split: spheres under an environment light, a line per material; truth first,
  /// then as the methods named in `spheres_of` give them at the largest number of lights.
  std::vector<std::byte> spheres;
};

/// Every method on one object under one split. `lights` are the numbers reported; `rig` may be
/// null.
JobResult run_job(const StudyScene& scene, const StudySplit& split, const StudyOptions& options,
                  std::span<const MethodSpec> methods, const std::vector<int>& lights,
                  const RigTime* rig);

/// Columns of JobResult::spheres after the truth: the methods of a study that are drawn.
std::vector<std::string> spheres_of(std::span<const MethodSpec> methods);

}  // namespace lightrig
