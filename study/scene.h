#pragma once

#include <memory>
#include <string>
#include <vector>

#include "core/candidate_bins.h"
#include "core/light.h"
#include "core/result.h"
#include "study/study.h"

namespace lightrig {

/// What every split of a study shares of one object: the cells that each candidate shows.
struct StudyScene {
  std::string object;       ///< name in tables
  std::string description;  ///< vertices, what was repaired
  std::string mesh_sha256;  ///< [input_hash.h]
  std::vector<LightPosition> candidates;
  CandidateBins vertex_bins;  ///< the paper's points
  CandidateBins pixel_bins;   ///< camera pixels with interpolated normals
  double seconds = 0;         ///< [s] to load, cast and bin, both kinds of point
};

/// `count` directions evenly over the sphere (Fibonacci's lattice), as distant lights.
std::vector<LightPosition> lights_over_sphere(int count);

/// Distant view along −z with y up, the object filling the image; distant lights.
Result<StudyScene> make_scene(const std::string& object, const StudyOptions& options,
                              const BivariateGrid& grid, const std::vector<std::uint8_t>& valid);

/// The objects of Table 1 with the paper's two numbers of lights and its printed errors.
struct Table1Entry {
  std::string object;  ///< as in `meshes`, or built in
  std::string paper_name;
  int lights[2] = {0, 0};
  double informed[2] = {0, 0};  ///< [%]
  double random[2] = {0, 0};    ///< [%]
  double random_sd[2] = {0, 0};
};
const std::vector<Table1Entry>& table1_entries();

}  // namespace lightrig
