#include "core/builtin_families.h"

namespace lightrig {
namespace {

// Dried binders [Gettens & Stout 1966; Polymer Handbook 1999].
constexpr double acrylic_binder = 1.49, alkyd = 1.52, linseed = 1.48, polyurethane = 1.50,
                 shellac = 1.52, nitrocellulose = 1.51, wax = 1.44;

using Colour = Eigen::Array3d;

// Aluminium, [Rakic 1995].
RefractiveIndex aluminium_flake() { return {{1.620, 1.011, 0.637}, {7.795, 6.616, 5.466}}; }
// Mica under titanium dioxide shines as a dielectric of high index [DeVore 1951].
RefractiveIndex pearl_flake() { return dielectric(2.6); }

MaterialSpec paint(const char* name, double binder, double roughness, double tail, Masking masking,
                   const Colour& colour) {
  return {name,
          "[Cook & Torrance 1982] [Kelemen & Szirmay-Kalos 2001] [Ribardiere 2017] "
          "[Gettens & Stout 1966]",
          {layer({facets(dielectric(binder), roughness, tail, masking)})},
          lambert(colour)};
}

MaterialSpec flat_paint(const char* name, double binder, double roughness, const Colour& colour,
                        double sigma) {
  return {name,
          "[Cook & Torrance 1982] [Heitz 2014] [Oren & Nayar 1994] [Gettens & Stout 1966]",
          {layer({facets(dielectric(binder), roughness, gaussian)})},
          oren_nayar(colour, sigma)};
}

// Flakes in a clear binder: coat, flakes covering a share of the view, pigment below.
MaterialSpec flakes(const char* name, double coat_roughness, double coat_tail,
                    const RefractiveIndex& flake, const Colour& tint, double flake_roughness,
                    double flake_tail, const Colour& pigment, const Colour& depth) {
  return {name,
          "[Cook & Torrance 1982] [Heitz 2014] [Ribardiere 2017] [Kelemen & Szirmay-Kalos 2001] "
          "[Weidlich & Wilkie 2007] [Ershov 2001] [Rakic 1995] [DeVore 1951]",
          {absorbing({facets(dielectric(polyurethane), coat_roughness, coat_tail)}, polyurethane,
                     depth),
           layer({facets(flake, flake_roughness, flake_tail, smith, tint)})},
          lambert(pigment)};
}

// A tinted or clear lacquer on metal or on a body.
MaterialSpec lacquer(const char* name, double index, double roughness, double tail,
                     const Colour& depth, std::vector<Lobe> below, const Body& body,
                     const char* constants) {
  MaterialSpec spec{name,
                    std::string("[Cook & Torrance 1982] [Heitz 2014] [Ribardiere 2017] [Kelemen & "
                                "Szirmay-Kalos 2001] [Weidlich & Wilkie 2007] ") +
                        constants,
                    {absorbing({facets(dielectric(index), roughness, tail)}, index, depth)},
                    body};
  if (!below.empty()) spec.layers.push_back(layer(std::move(below)));
  return spec;
}

}  // namespace

std::vector<MaterialSpec> builtin_paints() {
  return {
      paint("paint-gloss-white", alkyd, 0.015, 2, smith, {0.82, 0.82, 0.80}),
      paint("paint-gloss-black", alkyd, 0.020, 1.7, smith, {0.006, 0.006, 0.006}),
      paint("paint-gloss-red", alkyd, 0.04, 4, smith, {0.40, 0.02, 0.015}),
      paint("paint-satin-yellow", acrylic_binder, 0.12, 2, smith, {0.72, 0.48, 0.02}),
      paint("paint-satin-green", acrylic_binder, 0.18, 4, smith, {0.05, 0.22, 0.06}),
      paint("paint-eggshell-grey", acrylic_binder, 0.25, 2.5, smith, {0.30, 0.31, 0.32}),
      paint("paint-eggshell-purple", acrylic_binder, 0.30, gaussian, smith, {0.15, 0.04, 0.22}),
      flat_paint("paint-latex-green", acrylic_binder, 0.42, {0.10, 0.30, 0.15}, 0.3),
      flat_paint("paint-latex-blue", acrylic_binder, 0.50, {0.03, 0.06, 0.22}, 0.5),
      flat_paint("paint-flat-white", acrylic_binder, 0.60, {0.88, 0.88, 0.86}, 0.4),
      flat_paint("paint-optical-black", acrylic_binder, 0.70, {0.03, 0.03, 0.03}, 0.9),
      paint("paint-oil-brown", linseed, 0.09, 1.8, smith, {0.12, 0.06, 0.02}),
  };
}

std::vector<MaterialSpec> builtin_metallic_paints() {
  const RefractiveIndex metal = aluminium_flake(), pearl = pearl_flake();
  const Colour clear(0, 0, 0), full(1, 1, 1), half(0.5, 0.5, 0.5);
  return {
      flakes("metallic-silver", 0.010, 2, metal, full * 0.7, 0.25, gaussian, {0.1, 0.1, 0.1},
             clear),
      flakes("metallic-graphite", 0.015, 1.7, metal, full * 0.25, 0.30, 2, {0.01, 0.01, 0.01},
             clear),
      flakes("metallic-gold", 0.02, 2, metal, {0.75, 0.55, 0.2}, 0.22, 2.5, {0.20, 0.10, 0.02},
             clear),
      flakes("metallic-blue", 0.012, 3, metal, half, 0.18, 2, {0.01, 0.02, 0.10}, {1.2, 0.8, 0.2}),
      flakes("metallic-red", 0.03, 1.8, metal, half, 0.20, 4, {0.08, 0.005, 0.004},
             {0.15, 1.2, 1.4}),
      flakes("metallic-green", 0.025, 2, metal, half, 0.28, 1.8, {0.01, 0.05, 0.02},
             {0.9, 0.25, 0.8}),
      flakes("metallic-champagne", 0.05, 2, metal, {0.6, 0.5, 0.4}, 0.35, 2, {0.30, 0.24, 0.17},
             clear),
      flakes("pearl-white", 0.012, 2, pearl, full * 0.8, 0.18, 4, {0.60, 0.60, 0.58}, clear),
      flakes("pearl-violet", 0.06, 2.5, pearl, {0.7, 0.3, 0.9}, 0.15, 2, {0.06, 0.01, 0.12}, clear),
      flakes("pearl-bronze", 0.09, 4, pearl, {0.9, 0.5, 0.2}, 0.24, 1.7, {0.10, 0.04, 0.01},
             {0.1, 0.4, 0.9}),
      flakes("hammer-finish-grey", 0.08, 1.7, metal, full * 0.4, 0.45, gaussian, {0.08, 0.08, 0.09},
             clear),
      flakes("aluminium-primer", 0.35, 2, metal, full * 0.5, 0.40, 2, {0.20, 0.20, 0.20}, clear),
  };
}

std::vector<MaterialSpec> builtin_coated() {
  const RefractiveIndex aluminium = aluminium_flake();
  const RefractiveIndex brass{{0.445, 0.529, 1.084}, {3.770, 2.755, 1.834}};
  const RefractiveIndex copper{{0.22, 1.02, 1.24}, {3.747, 2.577, 2.397}};
  const RefractiveIndex iron{{2.92, 2.95, 2.59}, {3.10, 2.93, 2.77}};
  constexpr double alumina = 1.77;
  return {
      lacquer("anodised-red", alumina, 0.03, 2, {0.05, 1.2, 1.3}, {facets(aluminium, 0.12, 2)}, {},
              "[Rakic 1995] [Malitson 1962]"),
      lacquer("anodised-black", alumina, 0.10, 2, {1.8, 1.8, 1.8},
              {facets(aluminium, 0.25, gaussian)}, {}, "[Rakic 1995] [Malitson 1962]"),
      lacquer("anodised-clear", alumina, 0.015, 1.7, {0.02, 0.02, 0.03},
              {facets(aluminium, 0.20, 1.8)}, {}, "[Rakic 1995] [Malitson 1962]"),
      lacquer("brass-lacquered", nitrocellulose, 0.02, 2, {0.01, 0.05, 0.25},
              {facets(brass, 0.06, 2.5)}, {}, "[Querry 1985] [Gettens & Stout 1966]"),
      lacquer("copper-waxed", wax, 0.15, 4, {0, 0, 0}, {facets(copper, 0.10, 2)}, {},
              "[Johnson & Christy 1972] [Gettens & Stout 1966]"),
      lacquer("steel-oiled", linseed, 0.012, 2, {0.1, 0.15, 0.3}, {facets(iron, 0.18, 1.7)}, {},
              "[Johnson & Christy 1974] [Gettens & Stout 1966]"),
      lacquer("lacquer-black", nitrocellulose, 0.012, 2.2, {3, 3, 3}, {}, lambert({0.5, 0.5, 0.5}),
              "[Gettens & Stout 1966]"),
      lacquer("lacquer-red", nitrocellulose, 0.018, 1.8, {0.1, 1.6, 1.9}, {},
              lambert({0.7, 0.6, 0.5}), "[Gettens & Stout 1966]"),
      lacquer("varnish-over-matt", polyurethane, 0.025, 1.6, {0.02, 0.05, 0.12}, {},
              oren_nayar({0.5, 0.4, 0.3}, 0.5), "[Oren & Nayar 1994] [Gettens & Stout 1966]"),
      lacquer("glaze-over-haze", polyurethane, 0.010, 3, {0, 0, 0},
              {facets(dielectric(2.0), 0.08, 2)}, lambert({0.3, 0.1, 0.05}),
              "[Gettens & Stout 1966]"),
  };
}

std::vector<MaterialSpec> builtin_woods() {
  // Cell walls scatter forwards; lignin absorbs blue [Marschner 2005].
  const auto wood = [](const char* name, double index, double roughness, double tail,
                       const Colour& depth, const Colour& albedo, double asymmetry) {
    MaterialSpec spec = lacquer(name, index, roughness, tail, depth, {}, grains(albedo, asymmetry),
                                "[Hapke 1981] [Henyey & Greenstein 1941] [Marschner 2005] "
                                "[Gettens & Stout 1966]");
    return spec;
  };
  return {
      wood("oak-varnished", polyurethane, 0.06, 2, {0.05, 0.15, 0.4}, {0.90, 0.80, 0.62}, 0.2),
      wood("walnut-oiled", linseed, 0.22, gaussian, {0.1, 0.2, 0.4}, {0.62, 0.45, 0.30}, 0.3),
      wood("cherry-satin", polyurethane, 0.12, 1.8, {0.03, 0.25, 0.6}, {0.88, 0.68, 0.50}, 0.2),
      wood("maple-lacquered", nitrocellulose, 0.09, 2.5, {0.02, 0.05, 0.15}, {0.96, 0.92, 0.82},
           0.1),
      wood("pine-waxed", wax, 0.30, 2, {0, 0, 0}, {0.97, 0.90, 0.72}, 0.3),
      wood("mahogany-french-polish", shellac, 0.03, 1.7, {0.1, 0.6, 1.0}, {0.75, 0.48, 0.30}, 0.1),
      wood("ebony-polished", wax, 0.05, 2, {0.1, 0.1, 0.1}, {0.15, 0.12, 0.10}, 0),
      {"fruitwood-bare",
       "[Hapke 1981] [Henyey & Greenstein 1941] [Cook & Torrance 1982] [Marschner 2005]",
       {layer({facets(dielectric(1.54), 0.40, gaussian)})},
       grains({0.85, 0.70, 0.48}, 0.35)},
  };
}

}  // namespace lightrig
