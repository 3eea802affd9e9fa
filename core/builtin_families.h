#pragma once

#include <string>
#include <vector>

#include "core/reflectance_models.h"

namespace lightrig {

/// One entry of the built-in set before its tables are made.
struct MaterialSpec {
  std::string name;
  std::string source;  ///< keys of docs/sources.md, each in brackets
  std::vector<Layer> layers;
  Body body;
};

/// The families of the built-in set. Within a family constants are published ones (refractive
/// indices) and regular series (roughness, tail, colour), so that the set spans what such materials
/// do without imitating any measured sample.
std::vector<MaterialSpec> builtin_metals();
std::vector<MaterialSpec> builtin_metallic_paints();
std::vector<MaterialSpec> builtin_coated();
std::vector<MaterialSpec> builtin_plastics();
std::vector<MaterialSpec> builtin_rubbers();
std::vector<MaterialSpec> builtin_paints();
std::vector<MaterialSpec> builtin_woods();
std::vector<MaterialSpec> builtin_fabrics();
std::vector<MaterialSpec> builtin_ceramics();
std::vector<MaterialSpec> builtin_stones();
std::vector<MaterialSpec> builtin_powders();
std::vector<MaterialSpec> builtin_retroreflectors();

// Words for the tables above.

inline constexpr double gaussian = SlopeDistribution::beckmann;
inline constexpr Masking grooves = Masking::v_cavities;
inline constexpr Masking smith = Masking::smith;

inline RefractiveIndex dielectric(double n) {
  return {Eigen::Array3d::Constant(n), Eigen::Array3d::Zero()};
}

inline Lobe facets(const RefractiveIndex& index, double roughness, double tail,
                   Masking masking = smith, const Eigen::Array3d& weight = Eigen::Array3d::Ones()) {
  Lobe lobe;
  lobe.slopes = {roughness, tail};
  lobe.masking = masking;
  lobe.index = index;
  lobe.weight = weight;
  return lobe;
}

inline Lobe back_lobe(double roughness, double tail, const Eigen::Array3d& weight) {
  Lobe lobe;
  lobe.kind = Lobe::Kind::back;
  lobe.slopes = {roughness, tail};
  lobe.weight = weight;
  return lobe;
}

inline Lobe sheen(double r, const Eigen::Array3d& weight) {
  Lobe lobe;
  lobe.kind = Lobe::Kind::fibres;
  lobe.slopes = {r, SlopeDistribution::beckmann};
  lobe.weight = weight;
  return lobe;
}

inline Layer layer(std::vector<Lobe> lobes) { return {std::move(lobes), {0, 0, 0}, 1.5}; }

inline Layer absorbing(std::vector<Lobe> lobes, double index, const Eigen::Array3d& depth) {
  return {std::move(lobes), depth, index};
}

inline Body lambert(const Eigen::Array3d& albedo) {
  return {Body::Kind::lambert, albedo, 0, 0, 0, 1};
}

inline Body oren_nayar(const Eigen::Array3d& albedo, double sigma) {
  return {Body::Kind::oren_nayar, albedo, sigma, 0, 0, 1};
}

inline Body grains(const Eigen::Array3d& albedo, double asymmetry, double opposition = 0,
                   double surge_width = 0.05) {
  return {Body::Kind::particulate, albedo, 0, asymmetry, opposition, surge_width};
}

}  // namespace lightrig
