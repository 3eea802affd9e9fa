#include <gmock/gmock.h>

#include <cmath>
#include <limits>
#include <numbers>

#include "daemon/session/brdf_lookup.h"
#include "daemon/session/picture.h"
#include "daemon/session/result_pictures.h"
#include "daemon/session/sphere_view.h"

namespace lightrig {
namespace {

constexpr double nan = std::numeric_limits<double>::quiet_NaN();

BrdfTable constant_table(double f) {
  const BivariateGrid grid;
  return {grid, Eigen::ArrayXXd::Constant(grid.cells(), 3, f)};
}

// Values of IEC 61966-2-1 by hand: 255 · (1.055 · 0.5^(1/2.4) − 0.055) = 187.5.
TEST(Picture, EncodesLinearLightAsTheStandardSays) {
  EXPECT_EQ(srgb_byte(0), 0);
  EXPECT_EQ(srgb_byte(1), 255);
  EXPECT_EQ(srgb_byte(7), 255);
  EXPECT_EQ(srgb_byte(0.5), 188);
  EXPECT_EQ(srgb_byte(0.002), 7);  // 255 · 12.92 · 0.002 = 6.6
}

TEST(Picture, ShowsAnImageTenTimesAsBrightTheSame) {
  LinearImage dim{4, 1, {}};
  for (const float y : {0.01F, 0.05F, 0.2F, 0.9F}) {
    dim.pixels.push_back(Eigen::Array3f(y, 0.5F * y, 0.2F * y));
  }
  LinearImage bright = dim;
  for (Eigen::Array3f& pixel : bright.pixels) pixel *= 10;
  EXPECT_EQ(tone_mapped(dim, choose_tone(dim)).rgba, tone_mapped(bright, choose_tone(bright)).rgba);
}

TEST(Picture, IsTransparentWhereNothingIsShown) {
  const LinearImage image{2, 1, {Eigen::Array3f::Constant(0.2F), Eigen::Array3f::Constant(NAN)}};
  const Picture picture = tone_mapped(image, choose_tone(image));
  EXPECT_EQ(picture.rgba[3], 255);
  EXPECT_EQ(picture.rgba[7], 0);
}

TEST(Picture, MagnitudesGrowLighter) {
  int before = -1;
  for (int i = 0; i <= 20; ++i) {
    const Eigen::Array3i c = sequential_colour(i / 20.0);
    const int lightness = 2126 * c[0] + 7152 * c[1] + 722 * c[2];
    EXPECT_GT(lightness, before);
    before = lightness;
  }
}

TEST(Picture, SignedColoursAreWhiteAtZeroBlueBelowRedAbove) {
  EXPECT_TRUE((diverging_colour(0) == 247).all());
  EXPECT_GT(diverging_colour(-0.8)[2], diverging_colour(-0.8)[0]);
  EXPECT_GT(diverging_colour(0.8)[0], diverging_colour(0.8)[2]);
}

TEST(Picture, StandsBesideAnother) {
  const Picture left{1, 2, {1, 1, 1, 255, 2, 2, 2, 255}};
  const Picture right{1, 1, {9, 9, 9, 255}};
  const Picture row = beside(std::vector<Picture>{left, right}, 1);
  EXPECT_EQ(row.width, 3);
  EXPECT_EQ(row.height, 2);
  EXPECT_EQ(row.rgba, (std::vector<std::uint8_t>{1, 1, 1, 255, 0, 0, 0, 0, 9, 9, 9, 255,
                                                 2, 2, 2, 255, 0, 0, 0, 0, 0, 0, 0, 0}));
  EXPECT_EQ(enlarged(right, 2).rgba, (std::vector<std::uint8_t>{9, 9, 9, 255, 9, 9, 9, 255,  //
                                                                9, 9, 9, 255, 9, 9, 9, 255}));
}

TEST(BrdfLookup, GivesACellItsOwnValueAtItsCentre) {
  BrdfTable table = constant_table(1);
  for (int cell = 0; cell < table.grid.cells(); ++cell) table.f.row(cell) = 0.01 * (cell + 1);
  const BrdfLookup lookup(table);
  for (const int cell : {0, 89, 90, 4321, 8099}) {
    const int i_h = table.grid.row_h(cell), i_d = table.grid.column_d(cell);
    const double half_pi = std::numbers::pi / 2;
    const double theta_h = std::pow((i_h + 0.5) / 90, 2) * half_pi;
    EXPECT_NEAR(lookup(theta_h, (i_d + 0.5) / 90 * half_pi, 1) / table.f(cell, 1), 1, 1e-5);
  }
}

TEST(BrdfLookup, IsExactForWhatIsLinearInItsOwnTerms) {
  BrdfTable table = constant_table(1);
  for (int cell = 0; cell < table.grid.cells(); ++cell) {
    table.f.row(cell) = std::exp(-0.03 * table.grid.row_h(cell) + 0.01 * table.grid.column_d(cell));
  }
  const BrdfLookup lookup(table);
  const double half_pi = std::numbers::pi / 2;
  for (const double h : {10.3, 44.9, 71.5}) {
    for (const double d : {3.2, 40.7, 66.6}) {
      const double expected = std::exp(-0.03 * (h - 0.5) + 0.01 * (d - 0.5));
      EXPECT_NEAR(lookup(std::pow(h / 90, 2) * half_pi, d / 90 * half_pi, 0) / expected, 1, 1e-5);
    }
  }
}

TEST(BrdfLookup, FillsHolesFromTheNearestRowOfTheirColumn) {
  BrdfTable table = constant_table(0.5);
  table.f.row(table.grid.cell(40, 10)) = 2;
  for (int i_h = 41; i_h < 90; ++i_h) table.f.row(table.grid.cell(i_h, 10)) = nan;
  const BrdfLookup lookup(table);
  EXPECT_NEAR(lookup.at(table.grid.cell(80, 10), 2), 2, 1e-6);
}

// A white furnace: under the same radiance from everywhere a perfectly diffuse white sphere shows
// exactly that radiance at every point. The integral over half vectors shares nothing with this.
TEST(SphereView, VanishesInAWhiteFurnace) {
  const Environment everywhere([](const Eigen::Vector3d&) { return Eigen::Array3f::Constant(2); },
                               16);
  const BrdfTable white = constant_table(1 / std::numbers::pi);
  const std::vector<const BrdfTable*> materials{&white};
  const LinearImage image = render_spheres(materials, everywhere, 48, 2)[0];
  int shown = 0;
  for (int y = 0; y < 48; ++y) {
    for (int x = 0; x < 48; ++x) {
      const Eigen::Array3f& pixel = image.pixels[static_cast<std::size_t>(48 * y + x)];
      const double r = std::hypot(x - 23.5, y - 23.5) / 24;
      EXPECT_EQ(pixel.isNaN().any(), r >= 1);
      // At the very rim the view grazes and rings of half vectors are cut: looser there.
      if (r < 0.97) {
        EXPECT_NEAR(pixel[1], 2, 0.05) << x << ' ' << y;
      }
      shown += r < 0.97 ? 1 : 0;
    }
  }
  EXPECT_GT(shown, 1000);
}

// A nearly perfect mirror lobe shows the environment in the mirror direction.
TEST(SphereView, ShowsTheSurroundingsInAMirror) {
  const auto sky = [](const Eigen::Vector3d& d) -> Eigen::Array3f {
    return Eigen::Array3f::Constant(static_cast<float>(1 + 0.5 * d.y()));
  };
  // A narrow lobe D(θh)/(4 cos² θd) with ∫ D cos θh dω_h = 1 reflects about all light.
  const double alpha2 = 1e-4;
  const BrdfTable mirror = tabulate(
      [&](const HalfDiff& a) -> Eigen::Array3d {
        const double c = std::cos(a.theta_h), d = c * c * (alpha2 - 1) + 1;
        const double cos_d = std::cos(a.theta_d);
        return Eigen::Array3d::Constant(alpha2 / (std::numbers::pi * d * d) / (4 * cos_d * cos_d));
      },
      BivariateGrid{}, 1);
  const std::vector<const BrdfTable*> materials{&mirror};
  const LinearImage image = render_spheres(materials, Environment(sky, 64), 41, 1)[0];
  for (const int y : {10, 20, 30}) {
    const double v = 1 - 2 * (y + 0.5) / 41, z = std::sqrt(1 - v * v);
    const double up = 2 * z * v;  // y of the view mirrored at the normal (0, v, z)
    EXPECT_NEAR(image.pixels[static_cast<std::size_t>(41 * y + 20)][0], 1 + 0.5 * up, 0.12);
  }
}

TEST(SphereView, DoesNotDependOnTheNumberOfThreads) {
  const BrdfTable table = constant_table(0.2);
  const std::vector<const BrdfTable*> materials{&table};
  const Environment studio = studio_environment();
  const LinearImage one = render_spheres(materials, studio, 24, 1)[0];
  const LinearImage three = render_spheres(materials, studio, 24, 3)[0];
  for (std::size_t i = 0; i < one.pixels.size(); ++i) {
    EXPECT_TRUE(one.pixels[i].isNaN().all() || (one.pixels[i] == three.pixels[i]).all());
  }
}

TEST(TablePicture, HasTheHighlightLeftAndGrazingOnTop) {
  const BivariateGrid grid;
  std::vector<float> cells(static_cast<std::size_t>(grid.cells()), 0.0F);
  cells[static_cast<std::size_t>(grid.cell(0, 0))] = 1;
  cells[static_cast<std::size_t>(grid.cell(5, 89))] = 2;
  const std::vector<float> image = as_image(grid, cells);
  EXPECT_EQ(image[89 * 90 + 0], 1);  // bottom left
  EXPECT_EQ(image[0 * 90 + 5], 2);   // top row
}

TEST(TablePicture, DifferenceIsTheLogOfTheRatio) {
  const std::vector<float> difference =
      table_difference(constant_table(0.2), constant_table(0.1), 1e-4);
  EXPECT_NEAR(difference[1234], std::log(2.0), 1e-6);
}

}  // namespace
}  // namespace lightrig
