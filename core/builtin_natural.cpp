#include "core/builtin_families.h"

namespace lightrig {
namespace {

using Colour = Eigen::Array3d;

// Refractive indices: fibres [Morton & Hearle 2008], minerals and glasses [CRC 2016] and as cited.
constexpr double cotton = 1.56, polyester = 1.59, glaze = 1.51, alumina = 1.77, zirconia = 2.16,
                 silicon_nitride = 2.03, quartz = 1.55, calcite = 1.60, obsidian = 1.49;

MaterialSpec glossy(const char* name, double index, double roughness, double tail, Masking masking,
                    const Body& body, const char* constants) {
  return {name,
          std::string("[Cook & Torrance 1982] [Kelemen & Szirmay-Kalos 2001] [Ribardiere 2017] "
                      "[Oren & Nayar 1994] ") +
              constants,
          {layer({facets(dielectric(index), roughness, tail, masking)})},
          body};
}

// A deep layer of fibres, with or without a sheen of upright ones or a gloss.
MaterialSpec cloth(const char* name, std::vector<Lobe> lobes, const Body& body) {
  MaterialSpec spec{name,
                    "[Chandrasekhar 1960] [Hapke 1981] [Henyey & Greenstein 1941] [Estevez & Kulla "
                    "2017] [Oren & Nayar 1994] [Cook & Torrance 1982] [Morton & Hearle 2008]",
                    {},
                    body};
  if (!lobes.empty()) spec.layers.push_back(layer(std::move(lobes)));
  return spec;
}

MaterialSpec powder(const char* name, const Body& body) {
  return {
      name, "[Chandrasekhar 1960] [Hapke 1981] [Hapke 1986] [Henyey & Greenstein 1941]", {}, body};
}

MaterialSpec retro(const char* name, double roughness, double tail, const Colour& weight,
                   std::vector<Lobe> gloss, const Body& body) {
  gloss.push_back(back_lobe(roughness, tail, weight));
  return {name,
          "[Belcour 2014] [ASTM D4956] [Cook & Torrance 1982] [Heitz 2014] [Oren & Nayar 1994]",
          {layer(std::move(gloss))},
          body};
}

}  // namespace

std::vector<MaterialSpec> builtin_fabrics() {
  const auto grey = [](double w) { return Eigen::Array3d::Constant(w); };
  return {
      cloth("cotton-white", {}, grains({0.98, 0.98, 0.97}, 0.3)),
      cloth("cotton-blue", {}, grains({0.20, 0.40, 0.85}, 0.4)),
      cloth("cotton-black", {}, grains({0.12, 0.10, 0.10}, 0.5)),
      cloth("wool-beige", {sheen(0.5, grey(0.3))}, grains({0.90, 0.82, 0.68}, 0.5)),
      cloth("wool-red", {sheen(0.3, {0.4, 0.2, 0.2})}, grains({0.75, 0.15, 0.10}, 0.6)),
      cloth("felt-pink", {sheen(0.6, grey(0.5))}, grains({0.97, 0.70, 0.75}, 0.7)),
      cloth("felt-green", {}, grains({0.15, 0.60, 0.25}, 0.75)),
      cloth("velvet-black", {sheen(0.15, grey(0.25))}, grains({0.04, 0.03, 0.04}, 0.6)),
      cloth("velvet-violet", {sheen(0.2, {0.6, 0.2, 0.7})}, grains({0.40, 0.06, 0.50}, 0.4)),
      cloth("silk-white", {facets(dielectric(1.58), 0.30, 2)}, grains({0.98, 0.97, 0.94}, 0.2)),
      cloth("satin-dark", {facets(dielectric(polyester), 0.20, gaussian, grooves)},
            lambert({0.02, 0.015, 0.03})),
      cloth("nylon-cloth-red", {facets(dielectric(1.55), 0.45, 2)},
            oren_nayar({0.50, 0.04, 0.05}, 0.5)),
      cloth("linen-natural", {facets(dielectric(cotton), 0.55, gaussian)},
            oren_nayar({0.55, 0.45, 0.32}, 0.7)),
      cloth("denim-blue", {sheen(0.8, grey(0.2))}, oren_nayar({0.04, 0.07, 0.16}, 0.8)),
      cloth("microfibre-brown", {}, grains({0.45, 0.25, 0.12}, 0.85)),
  };
}

std::vector<MaterialSpec> builtin_ceramics() {
  const char* const crc = "[CRC 2016]";
  return {
      glossy("porcelain-glazed", glaze, 0.012, 1.8, smith, lambert({0.80, 0.79, 0.76}), crc),
      glossy("porcelain-bisque", glaze, 0.35, gaussian, smith, oren_nayar({0.82, 0.80, 0.76}, 0.3),
             crc),
      glossy("alumina-ground", alumina, 0.18, 2, smith, lambert({0.85, 0.84, 0.80}),
             "[Malitson 1962]"),
      glossy("alumina-polished", alumina, 0.025, 1.6, smith, lambert({0.75, 0.74, 0.70}),
             "[Malitson 1962]"),
      glossy("zirconia-black", zirconia, 0.015, 2, smith, lambert({0.004, 0.004, 0.004}),
             "[Wood & Nassau 1982]"),
      glossy("zirconia-white", zirconia, 0.07, 2, smith, lambert({0.80, 0.78, 0.72}),
             "[Wood & Nassau 1982]"),
      glossy("silicon-nitride", silicon_nitride, 0.04, 1.7, smith, lambert({0.03, 0.03, 0.03}),
             "[Luke 2015]"),
      glossy("silicon-carbide", 2.65, 0.10, 2, smith, lambert({0.015, 0.017, 0.02}),
             "[Shaffer 1971]"),
      glossy("tile-blue-glazed", glaze, 0.030, 4, smith, lambert({0.02, 0.06, 0.30}), crc),
      glossy("stoneware-salt-glaze", glaze, 0.09, 2.5, smith, oren_nayar({0.30, 0.20, 0.12}, 0.3),
             crc),
      glossy("terracotta", glaze, 0.60, gaussian, smith, oren_nayar({0.50, 0.20, 0.10}, 0.6), crc),
      glossy("basalt-ware", glaze, 0.28, 2, smith, oren_nayar({0.02, 0.02, 0.022}, 0.4), crc),
  };
}

std::vector<MaterialSpec> builtin_stones() {
  const char* const crc = "[CRC 2016]";
  return {
      glossy("marble-polished", calcite, 0.05, 1.7, smith, lambert({0.75, 0.74, 0.70}), crc),
      glossy("marble-honed", calcite, 0.22, 2, smith, lambert({0.70, 0.69, 0.66}), crc),
      glossy("obsidian", obsidian, 0.010, 1.8, smith, lambert({0.0006, 0.0006, 0.0006}), crc),
      glossy("granite-polished", quartz, 0.06, 2, smith, oren_nayar({0.22, 0.20, 0.19}, 0.2), crc),
      glossy("jasper-pink", quartz, 0.035, 4, smith, lambert({0.35, 0.15, 0.13}), crc),
      glossy("aventurine", quartz, 0.022, 1.6, smith, lambert({0.10, 0.04, 0.02}), crc),
      glossy("slate", quartz, 0.32, gaussian, smith, oren_nayar({0.06, 0.065, 0.07}, 0.5), crc),
      glossy("sandstone", quartz, 0.65, gaussian, smith, oren_nayar({0.45, 0.33, 0.20}, 0.7), crc),
      {"hematite-polished",
       "[Cook & Torrance 1982] [Heitz 2014] [Ribardiere 2017] [Barla 2018] [Querry 1985]",
       {layer({facets({{2.90, 3.05, 2.75}, {0.06, 0.30, 1.25}}, 0.03, 1.7, smith,
                      Eigen::Array3d::Constant(0.9)),
               facets({{2.90, 3.05, 2.75}, {0.06, 0.30, 1.25}}, 0.3, 2, smith,
                      Eigen::Array3d::Constant(0.1))})},
       lambert({0.01, 0.004, 0.003})},
  };
}

std::vector<MaterialSpec> builtin_powders() {
  return {
      powder("sintered-ptfe", lambert({0.98, 0.98, 0.98})),
      powder("barium-sulphate", grains({0.995, 0.995, 0.993}, 0, 0.2, 0.05)),
      powder("chalk", grains({0.98, 0.97, 0.95}, -0.1, 0.5, 0.05)),
      powder("regolith-lunar", grains({0.40, 0.33, 0.26}, -0.25, 1.5, 0.05)),
      powder("soot", grains({0.10, 0.10, 0.10}, -0.1, 1, 0.1)),
      powder("snow-fine", grains({0.999, 0.999, 0.998}, 0.6)),
      powder("iron-oxide-red", grains({0.80, 0.25, 0.12}, -0.2, 0.8, 0.08)),
      powder("ultramarine", grains({0.15, 0.20, 0.85}, 0.1, 0.4, 0.03)),
  };
}

std::vector<MaterialSpec> builtin_retroreflectors() {
  const auto grey = [](double w) { return Eigen::Array3d::Constant(w); };
  const RefractiveIndex face = dielectric(1.50);
  return {
      retro("sheeting-prismatic-white", 0.012, gaussian, grey(0.35), {facets(face, 0.02, 2)},
            lambert({0.35, 0.35, 0.35})),
      retro("sheeting-beads-yellow", 0.025, 2, {0.20, 0.14, 0.01}, {facets(face, 0.05, 2)},
            lambert({0.45, 0.30, 0.02})),
      retro("sheeting-beads-red", 0.03, 2, {0.10, 0.01, 0.008}, {facets(face, 0.03, 4)},
            lambert({0.18, 0.015, 0.01})),
      retro("tape-grey-cloth", 0.02, 1.7, grey(0.25), {}, oren_nayar(grey(0.25), 0.5)),
      retro("road-marking", 0.12, 2, grey(0.12), {}, oren_nayar(grey(0.6), 0.6)),
      retro("sign-black", 0.015, 2, grey(0.01), {facets(face, 0.04, 1.8)}, lambert(grey(0.01))),
  };
}

}  // namespace lightrig
