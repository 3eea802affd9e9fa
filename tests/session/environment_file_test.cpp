// Light from a latitude-longitude picture, as `lightrig reduce --environment` reads it.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "daemon/session/durable_file.h"
#include "daemon/session/frame_file.h"
#include "daemon/session/picture_file.h"
#include "tests/session/scratch.h"

namespace lightrig {
namespace {

using testing::HasSubstr;

/// An EXR of width × height pixels: sky above blue, ground dark, a red lamp a quarter turn to the
/// right of the middle at the horizon, and a green one straight behind the camera (the middle).
std::filesystem::path room(const Scratch& scratch, int width, int height, float level = 1) {
  std::vector<float> pixels;
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      const bool horizon = std::abs(y + 0.5 - height / 2.0) < height / 16.0;
      const bool right = horizon && std::abs(x + 0.5 - 0.75 * width) < width / 32.0;
      const bool middle = horizon && std::abs(x + 0.5 - 0.5 * width) < width / 32.0;
      pixels.push_back(right ? 30 * level : 0);
      pixels.push_back(middle ? 20 * level : 0);
      pixels.push_back(y < height / 2 - height / 8 ? 2 * level : 0);
    }
  }
  const auto bytes = encode_float_exr(width, height, {"R", "G", "B"}, pixels);
  const std::filesystem::path file = scratch.path() / "room.exr";
  EXPECT_TRUE(bytes && write_durably(file, *bytes));
  return file;
}

TEST(EnvironmentFile, PutsWhatIsInThePictureWhereTheHeaderSays) {
  const Scratch scratch;
  const auto light = read_environment(room(scratch, 128, 64));
  ASSERT_TRUE(light) << light.error().message;
  const Eigen::Array3f ahead = (*light)({0, 0, 1}), right = (*light)({-1, 0, 0});
  const Eigen::Array3f left = (*light)({1, 0, 0}), up = (*light)({0, 1, 0}),
                       down = (*light)({0, -1, 0});
  EXPECT_NEAR(ahead[1], 20, 0.2);
  EXPECT_NEAR(ahead[0], 0, 0.01);
  EXPECT_NEAR(right[0], 30, 0.3);  // who looks out of the sphere turns right towards −x
  EXPECT_NEAR(left[0], 0, 0.01);
  EXPECT_NEAR(up[2], 2, 0.02);
  EXPECT_TRUE((down < 0.01F).all());
}

// A diffuse white sphere shows E/π: under the blue half of the sky its top is blue and its bottom
// black, and the red lamp, which is to the viewer's left, lights its left side.
TEST(EnvironmentFile, LightsTheSphereOfTheReport) {
  const Scratch scratch;
  const auto light = read_environment(room(scratch, 128, 64));
  ASSERT_TRUE(light) << light.error().message;
  const BivariateGrid grid;
  const BrdfTable white{grid, Eigen::ArrayXXd::Constant(grid.cells(), 3, 1 / std::numbers::pi)};
  const std::vector<const BrdfTable*> materials{&white};
  const LinearImage image = render_spheres(materials, *light, 41, 2)[0];
  const auto at = [&](int x, int y) { return image.pixels[static_cast<std::size_t>(41 * y + x)]; };
  EXPECT_GT(at(20, 2)[2], 5 * at(20, 36)[2]);
  EXPECT_GT(at(3, 20)[0], 5 * at(37, 20)[0]);
  // At (4, 20) the normal is √(1 − 0.78²) = 0.625 as much towards the green lamp.
  EXPECT_NEAR(at(4, 20)[1] / at(20, 20)[1], 0.625, 0.03);
  // The lamp's solid angle about the horizon by hand: (2π/16) · 2 sin(π/16) = 0.1532 sr; seen from
  // the middle of the sphere's front it stands at 1, so that E/π · 1 = 20 · 0.1532/π · cos there.
  EXPECT_NEAR(at(20, 20)[1], 20 * 0.1532 / std::numbers::pi, 0.06);
}

TEST(EnvironmentFile, OfAnotherShapeWithoutLightOrMissingIsRefusedAndSaysWhy) {
  const Scratch scratch;
  const auto square = read_environment(room(scratch, 64, 64));
  ASSERT_FALSE(square);
  EXPECT_THAT(square.error().message, HasSubstr("twice as wide as high"));
  const auto dark = read_environment(room(scratch, 64, 32, 0));
  ASSERT_FALSE(dark);
  EXPECT_THAT(dark.error().message, HasSubstr("no light"));
  const auto none = read_environment(scratch.path() / "none.exr");
  ASSERT_FALSE(none);
  EXPECT_EQ(none.error().code, ErrorCode::not_found);
}

}  // namespace
}  // namespace lightrig
