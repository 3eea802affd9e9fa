#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "core/result.h"
#include "study/job.h"

namespace lightrig {

/// What identifies a study: everything that its rows depend on, one "key=value" per line. Two
/// folders belong together exactly when these are equal.
struct StudyIdentity {
  std::string text;
  std::vector<std::string> objects;      ///< in order
  std::vector<std::vector<int>> lights;  ///< per object
  int splits = 0;
  bool table1 = false;
  double seconds_per_light = 12;
  std::string materials;             ///< "builtin" or "directory"
  std::string rig;                   ///< name of the rig that capture times are of; "" none
  std::vector<std::string> methods;  ///< in order
  int jobs() const { return static_cast<int>(objects.size()) * splits; }
};

/// The folder's layout: OUT/study.txt, OUT/jobs/SPLIT-OBJECT.csv and .cost.csv, SPLIT.split.csv.
std::filesystem::path job_file(const std::filesystem::path& out, int split,
                               const std::string& object);
std::filesystem::path cost_file(const std::filesystem::path& out, int split,
                                const std::string& object);

std::filesystem::path split_file(const std::filesystem::path& out, int split);
std::filesystem::path spheres_file(const std::filesystem::path& out, const std::string& object);

/// Writes study.txt, or checks that the one there says the same. Errors: invalid_input.
Result<void> claim_folder(const std::filesystem::path& out, const StudyIdentity& identity);
Result<StudyIdentity> read_identity(const std::filesystem::path& out);

Result<void> store_job(const std::filesystem::path& out, int split, const std::string& object,
                       const JobResult& result);

/// What a split's bases learnt by leaving materials out, one line per basis: σ and range_slack.
Result<void> store_split(const std::filesystem::path& out, const StudySplit& split);
std::string split_header();

/// Rows of every job that is there, in the order splits × objects.
struct StoredStudy {
  StudyIdentity identity;
  std::vector<StudyRow> rows;
  std::vector<CostRow> costs;
  std::string splits;  ///< lines of every split that is there, without their header
  int jobs_there = 0;
  std::vector<std::pair<std::string, std::vector<std::byte>>> spheres;  ///< object, PNG
};
Result<StoredStudy> read_study(const std::filesystem::path& out);

}  // namespace lightrig
