#pragma once

#include <memory>
#include <string>
#include <vector>

#include "core/brdf_basis.h"
#include "core/brdf_table.h"
#include "core/result.h"
#include "study/row.h"
#include "study/scene.h"
#include "study/study.h"

namespace lightrig {

/// One division of the materials with the bases of the part that may be learnt from.
struct StudySplit {
  int index = 0;
  std::vector<Material> test;
  BrdfBasis paper;     ///< stacked channels, first K components
  BrdfBasis whole;     ///< channels as columns, all components: MAP
  double seconds = 0;  ///< [s] to make both
};
Result<StudySplit> make_split(std::span<const Material> materials, const StudyOptions& options,
                              int index);

/// What one job gives.
struct JobResult {
  std::vector<StudyRow> rows;
  std::vector<CostRow> costs;
};

/// Every method of the options on one object under one split. `lights` are the numbers reported.
JobResult run_job(const StudyScene& scene, const StudySplit& split, const StudyOptions& options,
                  const std::vector<int>& lights);

/// Whether the options ask for this method.
bool wanted(const StudyOptions& options, const std::string& method);

}  // namespace lightrig
