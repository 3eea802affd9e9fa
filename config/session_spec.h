#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <filesystem>
#include <limits>
#include <optional>
#include <string>
#include <vector>

#include "core/brdf_basis.h"
#include "core/candidate_bins.h"
#include "core/fit.h"
#include "core/planner.h"

namespace lightrig {

/// The object in front of the camera.
struct ObjectConfig {
  std::string shape;  ///< "sphere", "plane", "cylinder", "torus", "teapot", or "" for a mesh file
  std::filesystem::path mesh;  ///< PLY, OBJ or STL
  double unit = 1;             ///< [m] per mesh unit
  double size = 0.1;           ///< [m] built-in shapes: diameter, or largest extent
  int fineness = 1;
  Eigen::Isometry3d world_from_object = Eigen::Isometry3d::Identity();
};

/// The materials the basis is made of.
struct MaterialsConfig {
  std::string source = "builtin";               ///< "builtin", or a directory of MERL .binary files
  std::vector<std::string> leave_out_families;  ///< built-in set: families held out
  std::vector<std::string> leave_out;           ///< names held out
  int components = 0;                           ///< 0 = all the data support (MAP); the paper: 45
  ChannelLayout layout = ChannelLayout::columns;
  Mapping mapping = Mapping::ln_floor;
  double floor = 1e-4;  ///< [1/sr]
};

enum class PointSource : std::uint8_t { pixels, vertices };

struct PlanConfig {
  Criterion criterion = Criterion::condition;
  StopRule stop = StopRule::plateau;
  double plateau = 0.2;
  int max_lights = 7;
  PointSource points = PointSource::pixels;
  int pixel_stride = 1;
  ShadowRays shadows = ShadowRays::needed;
  GrazingLimits limits;
  int held_out_lights = 1;
  bool replan = true;  ///< choose the remaining lights anew where earlier ones lost rows
  bool random_baseline =
      true;                ///< report what as many random lights would have given (simulation only)
  std::uint64_t seed = 1;  ///< of the held-out choice and the random baseline
};

struct BracketConfig {
  std::vector<double> exposures;  ///< [s] on offer, shortest first
  double target_snr = 50;         ///< of the darkest site worth measuring
  bool metering = true;  ///< one metering frame per shot decides which exposures are needed
};

/// When to stop before the planned lights are done; whichever comes first.
struct StopConfig {
  std::optional<double> predicted_error_percent;
  std::optional<double> minutes;
  std::optional<int> lights;
};

/// One capture: what, with which statistics, how.
struct SessionSpec {
  ObjectConfig object;
  MaterialsConfig materials;
  PlanConfig plan;
  BracketConfig bracket;
  StopConfig stop;
  Estimator estimator = Estimator::map;
  std::string sample_id, operator_name, notes;
  std::filesystem::path
      reference;  ///< MERL file of a known truth to report the error against; "" for none
  std::filesystem::path path;  ///< of the session file; "" when the rig file holds all
  std::string text;            ///< its exact bytes
};

}  // namespace lightrig
