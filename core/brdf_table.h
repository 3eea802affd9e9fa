#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <functional>
#include <span>
#include <string>
#include <vector>

#include "core/bivariate_grid.h"
#include "core/result.h"

namespace lightrig {

/// A reflectance as a continuous function [1/sr] of the three angles; linear R, G, B.
using Reflectance = std::function<Eigen::Array3d(const HalfDiff&)>;

/// A BRDF on the bivariate grid.
struct BrdfTable {
  BivariateGrid grid;
  Eigen::ArrayXXd f;  ///< (cells × C) [1/sr], C = 1 or 3; NaN where there is no valid value.
};

/// A BRDF as MERL's file holds it, in 1/sr: n_h × n_d × n_phi cells (φd over 0 … π), channel-major.
struct MerlTable {
  int n_h = 90, n_d = 90, n_phi = 180;
  std::vector<double> f;  ///< f[((c · n_h + i_h) · n_d + i_d) · n_phi + i_phi] [1/sr]; NaN where
                          ///< invalid (file: < 0).
};

/// [1/sr] No material comes near: a mirror that is rough by 0.05° peaks at 1e5. What is above is
/// damage.
inline constexpr double most_reflectance = 1e6;

/// What was found in a MERL file besides valid numbers.
struct MerlFindings {
  std::size_t negative = 0;      ///< values below zero: marked invalid
  std::size_t not_a_number = 0;  ///< NaN or infinite: marked invalid
  std::size_t too_large = 0;     ///< above most_reflectance: marked invalid
};

/// Bytes of a MERL `.binary` file of any grid its header gives (three little-endian int32, then 3·n
/// float64, scaled by (1, 1.15, 1.66)/1500). Errors: invalid_input for a truncated, over-long or
/// absurd header (any n < 1, or the product above 2^28), naming what was found and what was
/// expected.
Result<MerlTable> decode_merl(std::span<const std::byte> bytes, MerlFindings& findings);
std::vector<std::byte> encode_merl(const MerlTable& table);

/// Mean over the valid φd cells whose directions lie above the horizon; NaN where none is.
BrdfTable to_bivariate(const MerlTable& table);

/// The bivariate table as a MERL table with n_phi equal slices (below-horizon cells marked invalid
/// when n_phi > 1).
MerlTable to_merl(const BrdfTable& table, int n_phi);

/// Samples a reflectance at the cell centres, mean over n_phi φd values above the horizon; NaN
/// where none is.
BrdfTable tabulate(const Reflectance& reflectance, const BivariateGrid& grid, int n_phi);

/// A material of a training or test set.
struct Material {
  std::string name;
  std::string family;  ///< e.g. "metal", "plastic"; "" where unknown
  std::string source;  ///< citation or file name
  BrdfTable table;
  /// (cells · bins × C) ln f at a share of φd less ln of the table's mean over φd
  /// [azimuth_model.h]; empty where the source has no φd.
  Eigen::ArrayXXf azimuth = {};
};

}  // namespace lightrig
