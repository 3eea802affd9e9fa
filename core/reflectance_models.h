#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <optional>
#include <vector>

#include "core/bivariate_grid.h"
#include "core/brdf_table.h"
#include "core/fresnel.h"
#include "core/half_diff.h"
#include "core/slope_distribution.h"

namespace lightrig {

/// How facets hide each other.
enum class Masking : std::uint8_t {
  smith,       ///< height-correlated [Heitz 2014]
  v_cavities,  ///< symmetric grooves [Torrance & Sparrow 1967; Cook & Torrance 1982]
};

/// One way in which a layer sends light back. Either side's energy is at most `weight`.
struct Lobe {
  enum class Kind : std::uint8_t {
    facets,  ///< about the mirror direction [Cook & Torrance 1982]
    back,    ///< about the direction the light came from: facets with one direction mirrored, no
             ///< Fresnel term [Belcour 2014]
    fibres,  ///< sheen of upright fibres; `slopes.roughness` is its r [Estevez & Kulla 2017]
  };
  Kind kind = Kind::facets;
  SlopeDistribution slopes;
  Masking masking = Masking::smith;
  RefractiveIndex index;                           ///< facets only
  Eigen::Array3d weight = Eigen::Array3d::Ones();  ///< [0, 1]; weights of a layer add up to ≤ 1
};

/// A layer lets through to what is below it, and out again, the share 1 − E(θ) that it does not
/// reflect [Kelemen & Szirmay-Kalos 2001], less what it absorbs on its way [Weidlich & Wilkie
/// 2007].
struct Layer {
  std::vector<Lobe> lobes;
  Eigen::Array3d optical_depth = Eigen::Array3d::Zero();  ///< along the normal, one way
  double index = 1.5;                                     ///< bends the way through it
};

/// What lies below the layers.
struct Body {
  enum class Kind : std::uint8_t {
    none,         ///< all light that arrives is absorbed
    lambert,      ///< [Lambert 1760], scaled so that all that enters and is not absorbed leaves
    oren_nayar,   ///< rough Lambertian facets, qualitative model [Oren & Nayar 1994]
    particulate,  ///< grains or fibres in a deep layer [Chandrasekhar 1960; Hapke 1981]
  };
  Kind kind = Kind::none;
  Eigen::Array3d albedo = Eigen::Array3d::Zero();  ///< [0, 1]; of a single grain if particulate
  double sigma = 0.3;     ///< oren_nayar: deviation of the facets' inclination [rad]
  double asymmetry = 0;   ///< particulate: mean cosine of a grain's scattering, (−1, 1) [Henyey &
                          ///< Greenstein 1941]
  double opposition = 0;  ///< particulate: amplitude of the opposition surge, ≥ 0
  double surge_width = 0.05;  ///< particulate: its angular half-width parameter h
};

/// What a reflectance depends on, so that swapping light and camera changes nothing at all.
struct Configuration {
  double sin2_h, cos_h, cos_d;
  double cos_i, cos_o;        ///< the larger cosine first; both > 0
  double ln_tan_i, ln_tan_o;  ///< logarithms of the tangents
};
/// Nothing where a direction is not above the horizon.
std::optional<Configuration> configuration(const HalfDiff& angles);

/// Configurations of a grid's cells: at every cell's centre, φd evenly over all values for which
/// both directions are above the horizon, so that every cell has some. Since φd and π − φd swap the
/// directions, half of n_phi are enough.
struct ConfigurationGrid {
  BivariateGrid grid;
  int per_cell;
  std::vector<Configuration> at;  ///< [cell · per_cell + k]
};
ConfigurationGrid configuration_grid(const BivariateGrid& grid, int n_phi);

/// Means over each cell's configurations of values (cells · per_cell × 3).
BrdfTable cell_means(const Eigen::ArrayXXd& each, const ConfigurationGrid& configurations);

/// A stack of layers on a body: non-negative, reciprocal, energy conserving and continuous; linear
/// red, green, blue [1/sr].
class LayeredReflectance {
 public:
  LayeredReflectance(std::vector<Layer> layers, const Body& body);

  Eigen::Array3d operator()(const HalfDiff& angles) const;

  /// Values at every configuration (cells · per_cell × 3). What depends on θh or θd alone is
  /// computed once a row or column.
  Eigen::ArrayXXd tabulate_each(const ConfigurationGrid& configurations) const;
  /// Means over each cell's φd.
  BrdfTable tabulate(const ConfigurationGrid& configurations) const;

  /// Share of light from this direction that the layers reflect, without the body; for tests.
  Eigen::Array3d layer_albedo(std::size_t layer, double cos_i) const;

 private:
  static constexpr int nodes = 64;
  using Transmission = Eigen::Array<double, 3, nodes + 1>;  // at cosines k/nodes

  struct PreparedLobe {
    Lobe lobe;
    std::size_t layer;
    SmithLambda lambda;
    double ln_roughness;
  };

  Eigen::Array3d through(std::size_t layer, const Configuration& c) const;
  double geometry(const PreparedLobe& lobe, const Configuration& c) const;
  Eigen::Array3d body_value(const Configuration& c, double phase, double surge) const;

  Body body_;
  std::size_t layer_count_;
  std::vector<PreparedLobe> lobes_;
  std::vector<Transmission> albedo_;   // of each layer by itself
  std::vector<Transmission> through_;  // of all layers above the l-th, one way
  Eigen::Array3d body_scale_;
};

}  // namespace lightrig
