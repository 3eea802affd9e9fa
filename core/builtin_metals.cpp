#include "core/builtin_families.h"

namespace lightrig {
namespace {

// Complex indices at 659, 549 and 451 nm: rows of the cited tables (1.88, 2.26 and 2.75 eV), linear
// between the neighbouring rows where a table has other wavelengths.
struct Metal {
  RefractiveIndex index;
  const char* source;
};
const char* const noble = "[Johnson & Christy 1972]";
const char* const transition = "[Johnson & Christy 1974]";

Metal silver() { return {{{0.05, 0.06, 0.04}, {4.483, 3.586, 2.657}}, noble}; }
Metal gold() { return {{{0.14, 0.43, 1.38}, {3.697, 2.455, 1.914}}, noble}; }
Metal copper() { return {{{0.22, 1.02, 1.24}, {3.747, 2.577, 2.397}}, noble}; }
Metal nickel() { return {{{1.99, 1.92, 1.73}, {4.26, 3.61, 2.95}}, transition}; }
Metal chromium() { return {{{3.09, 3.18, 2.33}, {3.34, 3.33, 3.14}}, transition}; }
Metal titanium() { return {{{2.76, 2.54, 2.27}, {3.84, 3.43, 3.04}}, transition}; }
Metal iron() { return {{{2.92, 2.95, 2.59}, {3.10, 2.93, 2.77}}, transition}; }
Metal cobalt() { return {{{2.25, 2.05, 1.74}, {4.27, 3.82, 3.28}}, transition}; }
Metal palladium() { return {{{1.80, 1.64, 1.41}, {4.42, 3.84, 3.26}}, transition}; }
Metal vanadium() { return {{{3.25, 4.00, 3.59}, {3.09, 3.04, 3.46}}, transition}; }
Metal manganese() { return {{{2.56, 2.39, 2.11}, {3.65, 3.33, 2.98}}, transition}; }
Metal aluminium() { return {{{1.620, 1.011, 0.637}, {7.795, 6.616, 5.466}}, "[Rakic 1995]"}; }
Metal tungsten() { return {{{3.704, 3.522, 3.315}, {2.942, 2.739, 2.516}}, "[Weaver 1975]"}; }
Metal brass() { return {{{0.445, 0.529, 1.084}, {3.770, 2.755, 1.834}}, "[Querry 1985]"}; }
Metal steel() {
  return {{{2.217, 1.902, 1.495}, {3.509, 3.167, 2.775}}, "[Karlsson & Ribbing 1982]"};
}

// One highlight.
MaterialSpec finish(const char* name, const Metal& metal, double roughness, double tail,
                    Masking masking = smith) {
  return {name,
          std::string("[Cook & Torrance 1982] [Heitz 2014] [Ribardiere 2017] ") + metal.source,
          {layer({facets(metal.index, roughness, tail, masking)})},
          {}};
}

// A polish with haze about it: shares of the surface are rougher by tens [Barla 2018].
MaterialSpec hazy(const char* name, const Metal& metal, double roughness, double tail,
                  double haze_roughness, double haze_share, double veil_share) {
  const auto share = [](double s) { return Eigen::Array3d::Constant(s); };
  return {name,
          std::string("[Cook & Torrance 1982] [Heitz 2014] [Ribardiere 2017] [Barla 2018] ") +
              metal.source,
          {layer({facets(metal.index, roughness, tail, smith, share(1 - haze_share - veil_share)),
                  facets(metal.index, haze_roughness, 1.6, smith, share(haze_share)),
                  facets(metal.index, 0.5, gaussian, grooves, share(veil_share))})},
          {}};
}

// A finish that is partly covered by something matt: dust, oxide, a blasted residue.
MaterialSpec dull(const char* name, const Metal& metal, double roughness, double tail,
                  double bare_share, const Eigen::Array3d& albedo, double sigma) {
  return {
      name,
      std::string("[Cook & Torrance 1982] [Ribardiere 2017] [Oren & Nayar 1994] ") + metal.source,
      {layer(
          {facets(metal.index, roughness, tail, grooves, Eigen::Array3d::Constant(bare_share))})},
      oren_nayar(albedo, sigma)};
}

}  // namespace

std::vector<MaterialSpec> builtin_metals() {
  return {
      hazy("silver-mirror", silver(), 0.012, 2, 0.05, 0.05, 0.002),
      finish("silver-satin", silver(), 0.18, 2.5),
      hazy("aluminium-polished", aluminium(), 0.012, 2.2, 0.10, 0.10, 0.01),
      finish("aluminium-brushed", aluminium(), 0.25, 1.8),
      dull("aluminium-blasted", aluminium(), 0.45, gaussian, 0.8, {0.5, 0.5, 0.5}, 0.5),
      hazy("gold-polished", gold(), 0.02, 2, 0.12, 0.08, 0.005),
      finish("gold-satin", gold(), 0.12, 1.7),
      finish("gold-matt", gold(), 0.35, gaussian, grooves),
      hazy("copper-polished", copper(), 0.03, 4, 0.15, 0.15, 0.01),
      finish("copper-rolled", copper(), 0.10, 2),
      dull("copper-tarnished", copper(), 0.20, 1.8, 0.5, {0.20, 0.09, 0.05}, 0.4),
      hazy("nickel-plated", nickel(), 0.010, 1.7, 0.06, 0.20, 0.004),
      finish("nickel-satin", nickel(), 0.15, 3),
      hazy("chromium-plated", chromium(), 0.010, 2.2, 0.03, 0.03, 0.0003),
      finish("chromium-satin", chromium(), 0.08, 1.6),
      finish("titanium-ground", titanium(), 0.22, 2),
      hazy("titanium-polished", titanium(), 0.025, 2.5, 0.2, 0.1, 0.002),
      finish("iron-cast", iron(), 0.40, 1.7, grooves),
      dull("iron-rusted", iron(), 0.30, 2, 0.15, {0.25, 0.10, 0.04}, 0.7),
      hazy("steel-polished", steel(), 0.010, 1.8, 0.08, 0.04, 0.001),
      finish("steel-rolled", steel(), 0.06, 1.6),
      finish("steel-brushed", steel(), 0.28, 2.5, grooves),
      dull("steel-oxidised", steel(), 0.15, 1.7, 0.6, {0.02, 0.02, 0.02}, 0.3),
      hazy("tungsten-lapped", tungsten(), 0.015, 2, 0.06, 0.02, 0.0005),
      finish("tungsten-sintered", tungsten(), 0.32, 2),
      finish("cobalt-polished", cobalt(), 0.045, 2.5),
      finish("palladium-satin", palladium(), 0.13, gaussian),
      finish("vanadium-polished", vanadium(), 0.035, 1.6),
      finish("manganese-ground", manganese(), 0.30, gaussian),
      hazy("brass-polished", brass(), 0.018, 2, 0.15, 0.2, 0.02),
      finish("brass-satin", brass(), 0.09, 2, grooves),
      dull("brass-aged", brass(), 0.15, 1.6, 0.4, {0.12, 0.08, 0.03}, 0.4),
  };
}

}  // namespace lightrig
