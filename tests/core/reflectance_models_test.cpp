#include "core/reflectance_models.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <complex>
#include <limits>
#include <numbers>

#include "core/fresnel.h"
#include "core/slope_distribution.h"

namespace lightrig {
namespace {

constexpr double pi = std::numbers::pi;

RefractiveIndex index_of(double n, double k) {
  return {Eigen::Array3d::Constant(n), Eigen::Array3d::Constant(k)};
}

TEST(Fresnel, GivesFourPercentForGlassAtNormalIncidence) {
  EXPECT_NEAR(fresnel(index_of(1.5, 0), 1)[0], 0.04, 1e-15);
}

TEST(Fresnel, KeepsHalfOfTheSenkrechtPartAtBrewstersAngle) {
  // tan θ = n: the parallel part vanishes and Rs = ((n² − 1)/(n² + 1))².
  const double n = 1.6, cosine = 1 / std::hypot(1, n);
  const double rs = std::pow((n * n - 1) / (n * n + 1), 2);
  EXPECT_NEAR(fresnel(index_of(n, 0), cosine)[1], rs / 2, 1e-15);
}

TEST(Fresnel, IsTotalAtTheHorizon) {
  EXPECT_NEAR(fresnel(index_of(1.5, 0), 0)[0], 1, 1e-15);
  EXPECT_NEAR(fresnel(index_of(0.14, 3.7), 0)[0], 1, 1e-15);
}

TEST(Fresnel, AgreesWithTheNormalIncidenceFormulaOfAMetal) {
  const double n = 0.43, k = 2.455;  // gold, green
  const double r = ((n - 1) * (n - 1) + k * k) / ((n + 1) * (n + 1) + k * k);
  EXPECT_NEAR(fresnel(index_of(n, k), 1)[2], r, 1e-14);
}

TEST(Fresnel, MeetsTheAmplitudeFormulasInComplexArithmetic) {
  using C = std::complex<double>;
  for (const double n : {0.05, 1.01, 1.5, 3.1}) {
    for (const double k : {0.0, 0.3, 4.5}) {
      for (const double cosine : {0.01, 0.2, 0.7, 0.99}) {
        const C m(n, k), inside = std::sqrt(m * m - (1 - cosine * cosine));  // m cos θt
        const C rs = (cosine - inside) / (cosine + inside);
        const C rp = (m * m * cosine - inside) / (m * m * cosine + inside);
        EXPECT_NEAR(fresnel(index_of(n, k), cosine)[0], 0.5 * (std::norm(rs) + std::norm(rp)),
                    1e-12)
            << n << " " << k << " " << cosine;
      }
    }
  }
}

struct SlopeCase {
  double roughness, tail;
};
class Slopes : public testing::TestWithParam<SlopeCase> {};

TEST_P(Slopes, ShowAsMuchProjectedAreaAsTheSurfaceHas) {
  // ∫ D cos dω = 1, over ln tan θ.
  const SlopeDistribution slopes{GetParam().roughness, GetParam().tail};
  double sum = 0;
  const double step = 0.005;
  for (double x = std::log(slopes.roughness) - 12; x < std::log(slopes.roughness) + 40; x += step) {
    const double t = std::exp(x), cos2 = 1 / (1 + t * t);
    const double d = normal_density(slopes, t * t * cos2, std::sqrt(cos2));
    sum += 2 * pi * d * t * t * cos2 * cos2 * step;  // cos θ dω = 2π tan θ cos⁴ θ d tan θ
  }
  EXPECT_NEAR(sum, 1, 2e-4);
}

TEST_P(Slopes, InvertTheirOwnDistribution) {
  const SlopeDistribution slopes{GetParam().roughness, GetParam().tail};
  const double t2 = tan2_quantile(slopes, 0.3), h = 1e-5;
  // d(share)/d(tan²) = π D cos⁴.
  const double rate = 2 * h / (tan2_quantile(slopes, 0.3 + h) - tan2_quantile(slopes, 0.3 - h));
  const double cos2 = 1 / (1 + t2);
  EXPECT_NEAR(rate / (pi * normal_density(slopes, t2 * cos2, std::sqrt(cos2)) * cos2 * cos2), 1,
              1e-6);
}

TEST_P(Slopes, MaskSoThatVisibleFacetsFillTheView) {
  // ∫ G₁(o) max(0, o·h) D(h) dω = cos θo [Heitz 2014, eq. 14]: exact for Smith's masking only if
  // Λ belongs to this very distribution.
  const SlopeDistribution slopes{GetParam().roughness, GetParam().tail};
  const SmithLambda lambda(slopes.tail);
  for (const double theta : {0.3, 1.0, 1.4, 1.55}) {
    const double cos_o = std::cos(theta), sin_o = std::sin(theta);
    double sum = 0;
    const double step = 0.02;
    const int sectors = 720;
    for (double x = std::log(slopes.roughness) - 9; x < std::log(slopes.roughness) + 25;
         x += step) {
      const double t = std::exp(x), cos2 = 1 / (1 + t * t), cos_h = std::sqrt(cos2);
      const double d = normal_density(slopes, t * t * cos2, cos_h);
      double seen = 0;
      for (int k = 0; k < sectors; ++k)
        seen += std::max(0.0, cos_o + sin_o * t * std::cos(2 * pi * (k + 0.5) / sectors));
      sum += 2 * pi * seen / sectors * cos_h * d * t * t * cos_h * cos2 * step;
    }
    const double masked = sum / (1 + lambda(-std::log(slopes.roughness * std::tan(theta))));
    EXPECT_NEAR(masked / cos_o, 1, 3e-3) << theta;
  }
}

INSTANTIATE_TEST_SUITE_P(Kinds, Slopes,
                         testing::Values(SlopeCase{0.02, SlopeDistribution::beckmann},
                                         SlopeCase{0.5, SlopeDistribution::beckmann},
                                         SlopeCase{0.1, 2}, SlopeCase{0.6, 2}, SlopeCase{0.1, 1.8},
                                         SlopeCase{0.3, 2.5}, SlopeCase{0.01, 3}));

TEST(SmithLambda, MatchesTheClosedFormsOfBeckmannAndGgx) {
  const SmithLambda gauss(SlopeDistribution::beckmann), ggx(2);
  for (const double a : {1e-6, 0.01, 0.1, 0.5, 1.0, 2.0}) {
    const double exact_gauss = 0.5 * (std::exp(-a * a) / (a * std::sqrt(pi)) - std::erfc(a));
    const double exact_ggx = 0.5 * (std::sqrt(1 + 1 / (a * a)) - 1);
    EXPECT_NEAR(1 / (1 + gauss(std::log(a))) * (1 + exact_gauss), 1, 3e-4) << a;
    EXPECT_NEAR(1 / (1 + ggx(std::log(a))) * (1 + exact_ggx), 1, 3e-4) << a;
  }
  EXPECT_EQ(ggx(std::numeric_limits<double>::infinity()), 0);
  EXPECT_EQ(gauss(20), 0);
}

TEST(LayeredReflectance, OfALambertBodyAloneIsConstant) {
  const LayeredReflectance f({}, {Body::Kind::lambert, {0.9, 0.5, 0.1}, 0, 0, 0, 1});
  EXPECT_TRUE(f({0.3, 0.4, 1.0}).isApprox(Eigen::Array3d(0.9, 0.5, 0.1) / pi, 1e-3));
  EXPECT_TRUE(f({0.3, 0.4, 1.0}).isApprox(f({0, 1.2, 0.1}), 1e-15));
}

TEST(LayeredReflectance, OfOneFacetLobeIsCookTorrance) {
  // By hand at θh = 0: D = 1/(π α²), G = 1/(1 + 2Λ), F, and cos θi = cos θo = cos θd.
  const double alpha = 0.3, theta_d = 0.8;
  Lobe lobe;
  lobe.slopes = {alpha, 2};
  lobe.index = index_of(1.5, 0);
  const LayeredReflectance f({Layer{{lobe}, {0, 0, 0}, 1.5}}, {});
  const double cosine = std::cos(theta_d), tangent = std::tan(theta_d);
  const double lambda = 0.5 * (std::sqrt(1 + alpha * alpha * tangent * tangent) - 1);
  const double expected = 1 / (pi * alpha * alpha) * fresnel(lobe.index, cosine)[0] /
                          (1 + 2 * lambda) / (4 * cosine * cosine);
  EXPECT_NEAR(f({0, theta_d, 0.7})[0] / expected, 1, 1e-3);
}

TEST(LayeredReflectance, OfABackLobePeaksWhereLightCameFrom) {
  Lobe lobe;
  lobe.kind = Lobe::Kind::back;
  lobe.slopes = {0.05, SlopeDistribution::beckmann};
  const LayeredReflectance f({Layer{{lobe}, {0, 0, 0}, 1.5}}, {});
  // Light and camera together, 40° off the normal: θh = 40°, θd = 0.
  const double together = f({40 * pi / 180, 0, 0})[0];
  EXPECT_GT(together, 50);
  EXPECT_LT(f({0, 40 * pi / 180, 0})[0], 1e-6 * together);  // mirror direction
}

TEST(LayeredReflectance, OfASmoothCoatOnWhiteLosesNothing) {
  // All that enters an unabsorbing white body leaves it: directional albedo 1, by the integral over
  // outgoing directions.
  Lobe lobe;
  lobe.slopes = {0.3, 2};
  lobe.index = index_of(1.5, 0);
  const LayeredReflectance f({Layer{{lobe}, {0, 0, 0}, 1.5}},
                             {Body::Kind::lambert, {1, 1, 1}, 0, 0, 0, 1});
  const double cos_i = 0.8, sin_i = 0.6;
  double albedo = 0;
  const int rings = 400, sectors = 400;
  for (int r = 0; r < rings; ++r) {
    const double cos_o = (r + 0.5) / rings, sin_o = std::sqrt(1 - cos_o * cos_o);
    for (int s = 0; s < sectors; ++s) {
      const double phi = pi * (s + 0.5) / sectors;
      const Eigen::Vector3d i(sin_i, 0, cos_i),
          o(sin_o * std::cos(phi), sin_o * std::sin(phi), cos_o);
      const Eigen::Vector3d h = (i + o).normalized();
      // cos φd from i·n = cos θh cos θd − sin θh sin θd cos φd.
      const double theta_h = std::acos(h.z()), theta_d = std::acos(std::min(1.0, i.dot(h)));
      const double swing = std::sin(theta_h) * std::sin(theta_d);
      const double cos_phi = swing > 1e-12 ? (h.z() * i.dot(h) - cos_i) / swing : 0;
      albedo += f({theta_h, theta_d, std::acos(std::clamp(cos_phi, -1.0, 1.0))})[0] * cos_o;
    }
  }
  albedo *= 2 * pi / (rings * sectors);
  EXPECT_NEAR(albedo, 1, 4e-3);
}

TEST(ConfigurationGrid, HasOnlyConfigurationsAboveTheHorizonAndAllOfThemWhereTheyAre) {
  const ConfigurationGrid grid = configuration_grid({}, 16);
  EXPECT_EQ(grid.per_cell, 8);
  ASSERT_EQ(grid.at.size(), 8100U * 8U);
  for (const Configuration& c : grid.at) {
    ASSERT_GT(c.cos_o, 0);
    ASSERT_GE(c.cos_i, c.cos_o);
    ASSERT_LE(c.cos_i, 1);
  }
  // θh = θd near 45°: all φd are just possible.
  const HalfDiff angles{0.7, 0.7, 0.2};
  EXPECT_TRUE(configuration(angles).has_value());
  EXPECT_FALSE(configuration({1.0, 1.0, 0.2}).has_value());
  EXPECT_TRUE(configuration({1.0, 1.0, pi / 2}).has_value());
}

}  // namespace
}  // namespace lightrig
