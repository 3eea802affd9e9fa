#include "core/builtin_families.h"

namespace lightrig {
namespace {

// Refractive indices n_D of polymers [Polymer Handbook 1999].
constexpr double ptfe = 1.35, silicone = 1.41, pom = 1.48, acrylic = 1.49, polyethylene = 1.51,
                 natural_rubber = 1.52, pvc = 1.53, nylon = 1.53, epoxy = 1.55, pet = 1.575,
                 polycarbonate = 1.585, polystyrene = 1.59, phenolic = 1.65;

// Colours of the body: red, green, blue shares that leave it again.
using Colour = Eigen::Array3d;
const Colour white(0.85, 0.84, 0.80), ivory(0.70, 0.60, 0.42), grey(0.22, 0.22, 0.22),
    charcoal(0.05, 0.05, 0.05), soot(0.012, 0.012, 0.011), pitch(0.001, 0.001, 0.001),
    red(0.45, 0.035, 0.02), orange(0.65, 0.22, 0.02), yellow(0.70, 0.50, 0.03),
    green(0.04, 0.25, 0.07), blue(0.015, 0.05, 0.35), violet(0.12, 0.02, 0.20),
    maroon(0.13, 0.01, 0.012), brown(0.16, 0.08, 0.04);

MaterialSpec plain(const char* name, double index, double roughness, double tail, Masking masking,
                   const Colour& colour) {
  return {name,
          "[Cook & Torrance 1982] [Kelemen & Szirmay-Kalos 2001] [Ribardiere 2017] "
          "[Polymer Handbook 1999]",
          {layer({facets(dielectric(index), roughness, tail, masking)})},
          lambert(colour)};
}

// Two roughnesses side by side: moulding skin and grain [Barla 2018].
MaterialSpec two_lobe(const char* name, double index, double fine, double coarse,
                      double coarse_share, const Colour& colour) {
  const Eigen::Array3d share = Eigen::Array3d::Constant(coarse_share);
  return {name,
          "[Cook & Torrance 1982] [Kelemen & Szirmay-Kalos 2001] [Ribardiere 2017] "
          "[Barla 2018] [Polymer Handbook 1999]",
          {layer({facets(dielectric(index), fine, 2, smith, 1 - share),
                  facets(dielectric(index), coarse, 2.5, smith, share)})},
          lambert(colour)};
}

MaterialSpec matt(const char* name, double index, double roughness, double tail,
                  const Colour& colour, double sigma) {
  return {name,
          "[Cook & Torrance 1982] [Heitz 2014] [Oren & Nayar 1994] [Polymer Handbook 1999]",
          {layer({facets(dielectric(index), roughness, tail)})},
          oren_nayar(colour, sigma)};
}

}  // namespace

std::vector<MaterialSpec> builtin_plastics() {
  return {
      plain("acrylic-white", acrylic, 0.010, 1.8, smith, white),
      plain("acrylic-blue", acrylic, 0.010, 2, smith, blue),
      plain("acrylic-violet", acrylic, 0.014, 1.6, smith, violet),
      plain("phenolic-black", phenolic, 0.011, 1.7, smith, pitch),
      plain("phenolic-red", phenolic, 0.016, 2, smith, red),
      plain("phenolic-yellow", phenolic, 0.020, 1.8, smith, yellow),
      two_lobe("phenolic-green", phenolic, 0.012, 0.08, 0.3, green),
      plain("polycarbonate-black", polycarbonate, 0.03, 2.5, smith, soot),
      plain("polycarbonate-orange", polycarbonate, 0.05, 4, smith, orange),
      two_lobe("polystyrene-grey", polystyrene, 0.04, 0.20, 0.4, grey),
      plain("polystyrene-maroon", polystyrene, 0.08, 2, smith, maroon),
      plain("pvc-ivory", pvc, 0.025, 1.6, smith, ivory),
      plain("pvc-charcoal", pvc, 0.06, 2, smith, charcoal),
      plain("nylon-white", nylon, 0.10, 4, smith, white),
      plain("nylon-black", nylon, 0.15, 2, smith, soot),
      plain("acetal-white", pom, 0.13, 3, smith, white),
      plain("polyethylene-milky", polyethylene, 0.28, gaussian, smith, ivory),
      plain("ptfe-white", ptfe, 0.22, 2, smith, white),
      plain("pet-blue", pet, 0.035, 2, smith, blue),
      matt("abs-matt-yellow", polystyrene, 0.35, gaussian, yellow, 0.3),
      matt("abs-matt-black", polystyrene, 0.40, 2, charcoal, 0.4),
      two_lobe("polyurethane-red", acrylic, 0.10, 0.40, 0.6, red),
      matt("polyurethane-foam", acrylic, 0.60, gaussian, grey, 0.8),
      plain("epoxy-green", epoxy, 0.018, 4, smith, green),
  };
}

std::vector<MaterialSpec> builtin_rubbers() {
  return {
      plain("rubber-natural", natural_rubber, 0.30, gaussian, smith, brown),
      plain("rubber-black", natural_rubber, 0.25, 2, smith, soot),
      matt("rubber-neoprene", pvc, 0.38, 2, charcoal, 0.5),
      plain("rubber-blue", natural_rubber, 0.35, 4, smith, blue),
      matt("rubber-violet", natural_rubber, 0.45, gaussian, violet, 0.3),
      plain("silicone-translucent", silicone, 0.20, 2.5, smith, ivory),
      two_lobe("rubber-tyre", natural_rubber, 0.18, 0.55, 0.7, pitch),
      matt("rubber-ball-white", natural_rubber, 0.50, 2, white, 0.35),
      plain("rubber-latex-polished", natural_rubber, 0.07, 1.8, smith, red),
  };
}

}  // namespace lightrig
