#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <span>
#include <string>
#include <vector>

#include "core/result.h"

namespace lightrig {

/// What a study covers: objects × splits of the materials × methods × numbers of lights.
struct StudyOptions {
  /// "sphere", "teapot", "torus", "cylinder"; a mesh file; or the name of one in `meshes`
  /// ("bunny").
  std::vector<std::string> objects = {"sphere"};
  std::filesystem::path meshes;       ///< folder that named meshes are looked for in
  std::string materials = "builtin";  ///< or a directory of MERL .binary files
  /// Names that method_spec() knows; empty means all of `study_methods()`, unless an axis is given.
  std::vector<std::string> methods;
  /// Axes: their product is added to the methods, over pixels. Criteria condition, a-optimal,
  /// random; estimators pseudo-inverse, map; numbers of components; exposures as below.
  std::vector<std::string> criteria, estimators;
  std::vector<int> component_counts, exposure_counts;
  std::vector<int> lights;  ///< numbers of lights reported; empty: 1 … max_lights
  int max_lights = 9;
  bool table1 =
      false;  ///< the paper's six objects at its two counts each; objects and lights unused
  int splits = 10;
  double train_fraction = 0.8;
  int random_runs = 6;    ///< light sets drawn at random per object and split
  int candidates = 1000;  ///< distant lights, evenly over the sphere
  int components = 45;    ///< of the paper's basis
  double floor = 1e-4;    ///< [1/sr]
  /// Bracketed capture: exposures of a 12-bit sensor, a factor 8 apart; rows outside are clipped.
  /// 0: no clipping.
  int exposures = 0;
  /// The bracket lies where it clips fewest rows of a material, as a metered session's does; false:
  /// about their median.
  bool metered = true;
  double noise = 0;  ///< relative standard deviation of a measured row
  std::uint64_t seed = 1;
  int shard_index = 0, shard_count = 1;  ///< this process does jobs index, index + count, …
  int threads = 1;
  std::filesystem::path out;
  /// [s] of rig time per light (move, settle, bracket) that plots against time assume and state.
  double seconds_per_light = 12;
  /// A rig file with a session's tables: capture times are then that rig's, by its motion model.
  std::filesystem::path rig;
};

struct StudyProgress {
  int jobs_done = 0, jobs_total = 0;  ///< of this shard; a job is one object under one split
  std::string job;                    ///< just finished
  double elapsed_s = 0, remaining_s = 0;
};

struct StudySummary {
  bool complete = false;                     ///< every job of every shard is there
  int jobs_done = 0, jobs_total = 0;         ///< of the whole study
  std::vector<std::string> remarks;          ///< objects not found, materials passed over
  std::string text;                          ///< readable table; Table 1 beside the paper's
  std::vector<std::filesystem::path> files;  ///< written
};

/// Every method's name and what it is, in the order of reports.
struct StudyMethod {
  std::string name;
  std::string description;
};
std::span<const StudyMethod> study_methods();

/// Runs this shard's jobs that `out` does not hold yet (a study interrupted goes on where it was),
/// one file per job under `out`/jobs. With every job there, writes study.csv, splits.csv (what
/// each split learnt by leaving materials out), cost.csv and report.html. The first two depend on
/// the options alone; what was measured stands in cost.csv.
/// Errors: invalid_input (options, or `out` holds another study), not_found, and those of writing.
Result<StudySummary> run_study(const StudyOptions& options,
                               const std::function<void(const StudyProgress&)>& progress);

/// Brings shards together: the same study.csv, byte for byte, as one run of the whole.
/// Errors: invalid_input when they are not shards of one study, not_found.
Result<StudySummary> merge_study(std::span<const std::filesystem::path> shards,
                                 const std::filesystem::path& out);

/// The report again from the jobs of a folder.
Result<StudySummary> summarize_study(const std::filesystem::path& out);

}  // namespace lightrig
