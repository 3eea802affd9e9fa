#include "core/builtin_materials.h"
#include "tests/paths.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <fstream>
#include <map>
#include <numbers>
#include <random>
#include <regex>
#include <set>
#include <sstream>

namespace lightrig {
namespace {

constexpr double pi = std::numbers::pi;

// Angles of two directions over the normal z, by the textbook formulas.
HalfDiff angles_of(const Eigen::Vector3d& i, const Eigen::Vector3d& o) {
  const Eigen::Vector3d h = (i + o).normalized();
  const double theta_h = std::atan2(std::hypot(h.x(), h.y()), h.z());
  const double theta_d = std::atan2(i.cross(h).norm(), i.dot(h));
  const double swing = std::sin(theta_h) * std::sin(theta_d);
  const double cos_phi = swing > 1e-300 ? (h.z() * i.dot(h) - i.z()) / swing : 0;
  return {theta_h, theta_d, std::acos(std::clamp(cos_phi, -1.0, 1.0))};
}

Eigen::Vector3d direction(double theta, double phi) {
  return {std::sin(theta) * std::cos(phi), std::sin(theta) * std::sin(phi), std::cos(theta)};
}

// The part of a hemispherical integral of f cos θo that lies within, or without, a cone about the
// direction of incidence. Polar coordinates about an axis, radius in ln tan: any peak at the axis
// is met however sharp. `about_half` integrates over half vectors, dωo = 4 cos θd dωh.
Eigen::Array3d albedo(const Reflectance& f, double theta_i, double cone) {
  const Eigen::Vector3d i = direction(theta_i, 0);
  Eigen::Array3d sum = Eigen::Array3d::Zero();
  const int sectors = 48;
  const double step = 0.08;
  for (double x = -9; x < 7; x += step) {
    const double theta = std::atan(std::exp(x));
    const double d_theta = std::sin(theta) * std::cos(theta) * step;  // d(atan eˣ)
    for (int s = 0; s < sectors; ++s) {
      const double phi = 2 * pi * (s + 0.5) / sectors;
      const double patch = std::sin(theta) * d_theta * 2 * pi / sectors;
      // Over half vectors, for all that does not go back where it came from.
      const Eigen::Vector3d h = direction(theta, phi);
      const double cos_d = i.dot(h);
      const Eigen::Vector3d mirrored = 2 * cos_d * h - i;
      if (cos_d > 0 && mirrored.z() > 0 && mirrored.dot(i) < std::cos(cone))
        sum += f(angles_of(i, mirrored)) * mirrored.z() * 4 * cos_d * patch;
      // Over directions about the way back, inside the cone.
      if (theta >= cone) continue;
      const Eigen::Vector3d back = Eigen::AngleAxisd(theta_i, Eigen::Vector3d::UnitY()) * h;
      if (back.z() > 0) sum += f(angles_of(i, back)) * back.z() * patch;
    }
  }
  return sum;
}

TEST(BuiltinMaterials, AreAtLeastAHundredInTwelveFamiliesWithUniqueSortedNames) {
  const auto all = builtin_materials();
  EXPECT_GE(all.size(), 100U);
  std::set<std::string> families;
  for (std::size_t k = 0; k < all.size(); ++k) {
    families.insert(all[k].family);
    EXPECT_TRUE(k == 0 || all[k - 1].name < all[k].name) << all[k].name;
    EXPECT_EQ(find_builtin(all[k].name), &all[k]);
  }
  EXPECT_EQ(families.size(), 12U);
  EXPECT_EQ(find_builtin("unobtainium"), nullptr);
}

TEST(BuiltinMaterials, AreReciprocalForAThousandPairsOfDirections) {
  std::mt19937_64 random(1);
  std::uniform_real_distribution<double> unit(0, 1);
  for (const BuiltinMaterial& material : builtin_materials()) {
    for (int k = 0; k < 1000; ++k) {
      const Eigen::Vector3d i = direction(std::acos(unit(random)), 2 * pi * unit(random));
      const Eigen::Vector3d o = direction(std::acos(unit(random)), 2 * pi * unit(random));
      const Eigen::Array3d there = material.reflectance(angles_of(i, o));
      const Eigen::Array3d back = material.reflectance(angles_of(o, i));
      ASSERT_TRUE((there >= 0).all() && there.allFinite()) << material.name;
      ASSERT_LE(((there - back).abs() / (there + 1e-12)).maxCoeff(), 1e-6) << material.name;
    }
  }
}

TEST(BuiltinMaterials, AreFiniteAtTheEdgesAndZeroBelowTheHorizon) {
  for (const BuiltinMaterial& material : builtin_materials()) {
    for (const double theta_h : {0.0, 1e-9, 0.5, pi / 2 - 1e-9, pi / 2}) {
      for (const double theta_d : {0.0, 1e-9, 0.7, pi / 2 - 1e-9, pi / 2}) {
        for (const double phi_d : {0.0, 1.0, pi / 2, pi}) {
          const Eigen::Array3d f = material.reflectance({theta_h, theta_d, phi_d});
          EXPECT_TRUE(f.allFinite() && (f >= 0).all())
              << material.name << " " << theta_h << " " << theta_d << " " << phi_d;
        }
      }
    }
    EXPECT_TRUE((material.reflectance({1.2, 1.0, 0}) == 0).all()) << material.name;
    EXPECT_TRUE((material.reflectance({0, 0, 0}) > 0).all()) << material.name;
  }
}

TEST(BuiltinMaterials, ReflectNoMoreThanTheyReceive) {
  for (const BuiltinMaterial& material : builtin_materials())
    for (const double degrees : {0.0, 30.0, 55.0, 70.0, 80.0, 86.0, 89.0})
      EXPECT_LE(albedo(material.reflectance, degrees * pi / 180, 0.2).maxCoeff(), 1.003)
          << material.name << " at " << degrees << " degrees";
}

TEST(BuiltinMaterials, HaveTheAlbedoThatTheirPhysicsDemands) {
  // A sharp metal reflects what Fresnel says; a Lambert body its albedo; a black lacquer only its
  // surface.
  const auto at = [](const char* name, double degrees) {
    return albedo(find_builtin(name)->reflectance, degrees * pi / 180, 0.2);
  };
  EXPECT_NEAR(at("cobalt-polished", 0)[1], fresnel({{2.05, 2.05, 2.05}, {3.82, 3.82, 3.82}}, 1)[1],
              0.01);
  EXPECT_NEAR(at("sintered-ptfe", 50)[0], 0.98, 3e-3);
  EXPECT_NEAR(at("lacquer-black", 0)[0], fresnel({{1.51, 1.51, 1.51}, {0, 0, 0}}, 1)[0], 5e-3);
}

TEST(BuiltinMaterials, AreContinuous) {
  std::mt19937_64 random(2);
  std::uniform_real_distribution<double> unit(0, 1);
  for (const BuiltinMaterial& material : builtin_materials()) {
    for (int k = 0; k < 200; ++k) {
      const double root = unit(random);
      const HalfDiff here{root * root * 1.4, unit(random) * 1.5, unit(random) * pi};
      const auto at_here = configuration(here);
      if (!at_here || at_here->cos_o < 1e-3) continue;
      const double d = 1e-8;
      const HalfDiff near{here.theta_h + d, here.theta_d + d, here.phi_d + d};
      const Eigen::Array3d f = material.reflectance(here), g = material.reflectance(near);
      ASSERT_LE(((f - g).abs() / (f + 1e-9)).maxCoeff(), 1e-4) << material.name;
    }
  }
}

TEST(BuiltinTables, AreTheMeansOfTheReflectances) {
  const BivariateGrid grid{12, 10};
  const std::vector<Material> tables = builtin_tables(grid, 16);
  const auto all = builtin_materials();
  ASSERT_EQ(tables.size(), all.size());
  for (std::size_t m = 0; m < all.size(); ++m) {
    for (const auto& [i_h, i_d] : {std::pair{0, 2}, {3, 7}, {6, 1}, {8, 4}}) {
      const double root = (i_h + 0.5) / grid.n_h;
      Eigen::Array3d mean = Eigen::Array3d::Zero();
      for (int k = 0; k < 16; ++k)
        mean += all[m].reflectance(
                    {root * root * pi / 2, (i_d + 0.5) / grid.n_d * pi / 2, (k + 0.5) * pi / 16}) /
                16;
      const Eigen::Array3d table = tables[m].table.f.row(grid.cell(i_h, i_d)).transpose();
      ASSERT_LE(((table - mean).abs() / (mean + 1e-30)).maxCoeff(), 1e-9) << all[m].name;
    }
    EXPECT_TRUE(tables[m].table.f.allFinite() && (tables[m].table.f >= 0).all()) << all[m].name;
  }
}

TEST(BuiltinMaterials, CiteOnlySourcesThatTheDocumentLists) {
  std::ifstream file(std::string(lightrig::test::source_dir) + "/docs/sources.md");
  std::stringstream text;
  text << file.rdbuf();
  const std::string sources = text.str();
  ASSERT_FALSE(sources.empty());
  const std::regex key(R"(\[[^\]]+\])");
  for (const BuiltinMaterial& material : builtin_materials()) {
    const auto begin = std::sregex_iterator(material.source.begin(), material.source.end(), key);
    EXPECT_NE(begin, std::sregex_iterator()) << material.name << " cites nothing";
    for (auto cited = begin; cited != std::sregex_iterator(); ++cited)
      EXPECT_NE(sources.find("**" + cited->str() + "**"), std::string::npos)
          << material.name << " cites " << cited->str();
  }
}

}  // namespace
}  // namespace lightrig
