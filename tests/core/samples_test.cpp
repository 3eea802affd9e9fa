#include "core/samples.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <numeric>
#include <random>
#include <tuple>

#include "core/shapes.h"

namespace lightrig {
namespace {

/// A sphere seen in perspective under a near lamp, its radiance written from the closed form of a
/// Lambertian surface, f constant.
class Extract : public testing::Test {
 protected:
  Extract() : mesh_(make_sphere(0.05, 2)), occluder_(mesh_) {
    camera_.width = 160;
    camera_.height = 140;
    camera_.fx = camera_.fy = 500;
    camera_.cx = 79.5;
    camera_.cy = 69.5;
    camera_.camera_from_world =
        look_at({0, 0, 0.5}, Eigen::Vector3d::Zero(), Eigen::Vector3d::UnitY());
    points_ = points_of_pixels(mesh_, occluder_, camera_, 1);
    options_.lamp_strength = Eigen::Array3d(2, 3, 4);
  }

  RadianceImage lambert(const Eigen::Array3d& f, ColorFilter filter) const {
    const std::size_t sites = 160 * 140;
    RadianceImage image{160,
                        140,
                        filter,
                        std::vector<float>(sites, 0.0F),
                        std::vector<float>(sites, 1e-10F),
                        std::vector<RadianceImage::Site>(sites, RadianceImage::Site::measured)};
    for (Eigen::Index i = 0; i < points_.size(); ++i) {
      const int source = points_.source[static_cast<std::size_t>(i)];
      const int channel = channel_at(filter, source / 160, source % 160);
      const Eigen::Vector3d x = points_.position.col(i), to_lamp = lamp_.p - x;
      const double cos_i = std::max(0.0, points_.normal.col(i).dot(to_lamp.normalized()));
      const double E = options_.lamp_strength[channel] / to_lamp.squaredNorm() * cos_i;
      image.L[static_cast<std::size_t>(source)] = static_cast<float>(f[channel] * E);
    }
    return image;
  }

  BrdfObservations run(const RadianceImage& image, const RadianceImage* ambient = nullptr) const {
    return extract(image, ambient, points_, camera_, lamp_, grid_, {}, occluder_, options_);
  }

  Mesh mesh_;
  Occluder occluder_;
  CameraModel camera_;
  SurfacePoints points_;
  LightPosition lamp_{false, {0.3, 0.2, 0.4}};
  BivariateGrid grid_;
  ExtractOptions options_;
};

TEST_F(Extract, FindsALambertianSurfaceConstantInEveryCell) {
  const BrdfObservations found = run(lambert(Eigen::Array3d::Constant(0.2), ColorFilter::mono));
  ASSERT_GT(found.rows.size(), 50U);
  for (const BrdfObservation& row : found.rows) {
    EXPECT_EQ(row.kind, BrdfObservation::Kind::value);
    EXPECT_NEAR(row.f, 0.2, 1e-6);
  }
}

TEST_F(Extract, KeepsTheChannelsOfABayerMosaicApart) {
  const BrdfObservations found =
      run(lambert(Eigen::Array3d(0.1, 0.2, 0.3), ColorFilter::bayer_grbg));
  int channels[3] = {0, 0, 0};
  for (const BrdfObservation& row : found.rows) {
    EXPECT_NEAR(row.f, 0.1 * (row.channel + 1), 1e-6);
    ++channels[row.channel];
  }
  EXPECT_GT(*std::min_element(channels, channels + 3), 30);
  EXPECT_TRUE(
      std::is_sorted(found.rows.begin(), found.rows.end(), [](const auto& a, const auto& b) {
        return std::pair(a.channel, a.cell) < std::pair(b.channel, b.cell);
      }));
}

TEST_F(Extract, TakesAmbientLightOff) {
  RadianceImage image = lambert(Eigen::Array3d::Constant(0.2), ColorFilter::mono);
  RadianceImage ambient = image;
  for (std::size_t i = 0; i < image.L.size(); ++i) {
    ambient.L[i] = 0.37F;
    image.L[i] += 0.37F;
  }
  const BrdfObservations found = run(image, &ambient);
  EXPECT_GT(found.rows.size(), 50U);
  for (const BrdfObservation& row : found.rows) EXPECT_NEAR(row.f, 0.2, 1e-5);
}

TEST_F(Extract, LeavesOutPixelsThatMixObjectAndBackground) {
  // Half of every silhouette pixel is black background.
  RadianceImage image = lambert(Eigen::Array3d::Constant(0.2), ColorFilter::mono);
  std::vector<std::uint8_t> object(image.L.size(), 0);
  for (const int source : points_.source) object[static_cast<std::size_t>(source)] = 1;
  for (const int source : points_.source) {
    const auto at = static_cast<std::size_t>(source);
    if (!object[at - 1] || !object[at + 1] || !object[at - 160] || !object[at + 160]) {
      image.L[at] /= 2;
    }
  }
  options_.limits = no_grazing_limits;
  const BrdfObservations found = run(image);
  EXPECT_GT(found.statistics.boundary, 50);
  for (const BrdfObservation& row : found.rows) EXPECT_NEAR(row.f, 0.2, 1e-5);
  options_.drop_mixed = false;
  double worst = 0;
  for (const BrdfObservation& row : run(image).rows) {
    worst = std::max(worst, std::abs(row.f - 0.2));
  }
  EXPECT_GT(worst, 0.02);
}

TEST_F(Extract, LeavesOutWhatSomethingUnknownShadowsAndWhatIsBesideIt) {
  const RadianceImage whole = lambert(Eigen::Array3d::Constant(0.2), ColorFilter::mono);
  RadianceImage image = whole;
  // A post's shadow: black, with edges half as bright.
  for (std::size_t at = 0; at < image.L.size(); ++at) {
    const std::size_t column = at % 160;
    if (column >= 88 && column <= 102) image.L[at] = 0;
    if (column == 87 || column == 103) image.L[at] /= 2;
    image.variance[at] = 1e-6F;
  }
  const Eigen::ArrayXXd least_f = Eigen::ArrayXXd::Constant(grid_.cells(), 1, 0.1);
  options_.least_f = &least_f;
  const BrdfObservations found = run(image);
  EXPECT_GT(found.statistics.blocked, 500);
  for (const BrdfObservation& row : found.rows) {
    EXPECT_NEAR(row.f, 0.2, 1e-5);
    EXPECT_EQ(row.kind, BrdfObservation::Kind::value);
  }
  // What is left of it is kept apart: cells that only the shadow shows.
  EXPECT_GT(found.black.size(), 10U);
  for (const BrdfObservation& row : found.black) {
    EXPECT_EQ(row.kind, BrdfObservation::Kind::below);
    EXPECT_FALSE(std::ranges::any_of(
        found.rows, [&](const BrdfObservation& other) { return other.cell == row.cell; }));
  }
  // Where known materials are dark themselves, or nothing is known of them, black is a value.
  const Eigen::ArrayXXd dark = Eigen::ArrayXXd::Constant(grid_.cells(), 1, 1e-4);
  options_.least_f = &dark;
  const BrdfObservations doubted = run(image);
  EXPECT_EQ(doubted.statistics.blocked, 0);
  // Yet it is known what a brighter one could not have left black: what 0.1 has told above.
  std::int64_t doubtful = 0;
  for (const BlackSites& black : doubted.doubtful) {
    EXPECT_GT(black.telling_f, 1e-4);
    doubtful += black.telling_f <= 0.1 ? black.count : 0;
  }
  EXPECT_GE(doubtful, found.statistics.blocked);  // all of a cell, where some of it are told
  options_.least_f = nullptr;
  const BrdfObservations believed = run(image);
  EXPECT_EQ(believed.statistics.blocked, 0);
  EXPECT_TRUE(std::ranges::any_of(believed.rows, [](const BrdfObservation& row) {
    return row.kind == BrdfObservation::Kind::below;
  }));
  // Without a shadow nothing is left out.
  options_.least_f = &least_f;
  EXPECT_EQ(run(whole).rows.size(),
            run(lambert(Eigen::Array3d::Constant(0.2), ColorFilter::mono)).rows.size());
  EXPECT_EQ(run(whole).statistics.blocked, 0);
}

TEST_F(Extract, TurnsFullCellsIntoLowerBoundsAndDarkOnesIntoUpperBounds) {
  RadianceImage image = lambert(Eigen::Array3d::Constant(0.2), ColorFilter::mono);
  for (std::size_t i = 0; i < image.L.size(); ++i) {
    image.site[i] = RadianceImage::Site::saturated;
    image.L[i] *= 0.5F;  // the bound
    image.variance[i] = HUGE_VALF;
  }
  for (const BrdfObservation& row : run(image).rows) {
    EXPECT_EQ(row.kind, BrdfObservation::Kind::above);
    EXPECT_LE(row.f, 0.2);
    EXPECT_NEAR(row.f, 0.1, 1e-5);
  }
  std::mt19937_64 random(1);
  std::normal_distribution<float> normal;
  for (std::size_t i = 0; i < image.L.size(); ++i) {
    image.site[i] = RadianceImage::Site::dark;
    image.variance[i] = 1.0F;
    image.L[i] = 1e-4F + normal(random);
  }
  int below = 0, rows = 0;
  for (const BrdfObservation& row : run(image).rows) {
    below += row.kind == BrdfObservation::Kind::below;
    ++rows;
    if (row.kind == BrdfObservation::Kind::below) {
      EXPECT_GT(row.f, 0);
    }
  }
  EXPECT_GT(below, 9 * rows / 10);
}

TEST_F(Extract, IsUnbiasedUnderNoiseThatFollowsTheSignal) {
  // Shot noise of 4 to 100 electrons per site, the variance estimated from the noisy value itself
  // as a merge must: inverse-variance weights would read several percent low.
  const RadianceImage clean = lambert(Eigen::Array3d::Constant(0.2), ColorFilter::mono);
  std::mt19937_64 random(2);
  double sum = 0, weight = 0;
  for (int run_index = 0; run_index < 40; ++run_index) {
    RadianceImage image = clean;
    for (std::size_t i = 0; i < image.L.size(); ++i) {
      const double electrons = double{clean.L[i]} * 30;
      const auto drawn = static_cast<double>(
          electrons > 0 ? std::poisson_distribution<int>(electrons)(random) : 0);
      image.L[i] = static_cast<float>(drawn / 30);
      image.variance[i] = static_cast<float>((drawn + 1) / 900);
    }
    for (const BrdfObservation& row : run(image).rows) {
      if (row.kind != BrdfObservation::Kind::value || row.count < 5) continue;
      sum += row.f * row.count;
      weight += row.count;
    }
  }
  EXPECT_NEAR(sum / weight / 0.2, 1, 0.004);
}

TEST_F(Extract, GivesTheSameRowsOnAnyNumberOfThreads) {
  const RadianceImage image = lambert(Eigen::Array3d::Constant(0.2), ColorFilter::bayer_rggb);
  const BrdfObservations one = run(image);
  options_.threads = 3;
  const BrdfObservations three = run(image);
  EXPECT_GT(one.rows.size(), 100U);
  ASSERT_EQ(one.rows.size(), three.rows.size());
  for (std::size_t i = 0; i < one.rows.size(); ++i) {
    EXPECT_EQ(one.rows[i].f, three.rows[i].f);
    EXPECT_EQ(one.rows[i].variance, three.rows[i].variance);
  }
}

// Points of pixels are summed in runs that lie side by side in one cell, others one by one. The
// same points told as vertices, which project to the very same sites, must give the same bits.
TEST_F(Extract, SumsRunsOfPixelsToTheVeryBitsOfPixelByPixel) {
  std::mt19937_64 random(11);
  std::uniform_real_distribution<float> uniform(0.5F, 1.5F);
  for (const ColorFilter filter : {ColorFilter::mono, ColorFilter::bayer_grbg}) {
    RadianceImage image = lambert(Eigen::Array3d(0.1, 0.2, 0.3), filter);
    RadianceImage ambient = image;
    for (std::size_t i = 0; i < image.L.size(); ++i) {
      image.L[i] *= uniform(random);
      image.variance[i] = 1e-3F * image.L[i] * image.L[i] * uniform(random);
      ambient.L[i] = 0.01F * uniform(random);
      if (random() % 17 == 0) image.site[i] = RadianceImage::Site::saturated;
      if (random() % 13 == 0) image.site[i] = RadianceImage::Site::dark;
      if (random() % 97 == 0) ambient.site[i] = RadianceImage::Site::saturated;
    }
    options_.drop_mixed = false;  // only pixels have neighbours to mix with
    const BrdfObservations in_runs = run(image, &ambient);
    SurfacePoints one_by_one = points_;
    one_by_one.from_pixels = false;
    const BrdfObservations plain =
        extract(image, &ambient, one_by_one, camera_, lamp_, grid_, {}, occluder_, options_);
    ASSERT_GT(in_runs.rows.size(), 50U);
    ASSERT_EQ(in_runs.rows.size(), plain.rows.size());
    for (std::size_t i = 0; i < plain.rows.size(); ++i) {
      const BrdfObservation &a = in_runs.rows[i], &b = plain.rows[i];
      ASSERT_EQ(std::tuple(a.cell, a.channel, a.kind, a.count),
                std::tuple(b.cell, b.channel, b.kind, b.count));
      EXPECT_EQ(a.f, b.f);
      EXPECT_EQ(a.variance, b.variance);
    }
    EXPECT_EQ(in_runs.statistics.saturated, plain.statistics.saturated);
    EXPECT_EQ(in_runs.statistics.dark, plain.statistics.dark);
    EXPECT_GT(plain.statistics.saturated, 0);
  }
}

TEST_F(Extract, SaysTheSameOfPixelsInWhateverOrder) {
  // Pixels side by side are summed a run at a time; shuffled, no two of them stand side by side.
  options_.drop_mixed = false;
  SurfacePoints shuffled = points_;
  std::vector<Eigen::Index> order(static_cast<std::size_t>(points_.size()));
  std::iota(order.begin(), order.end(), 0);
  std::shuffle(order.begin(), order.end(), std::mt19937_64(5));
  for (std::size_t i = 0; i < order.size(); ++i) {
    const auto to = static_cast<Eigen::Index>(i);
    shuffled.position.col(to) = points_.position.col(order[i]);
    shuffled.normal.col(to) = points_.normal.col(order[i]);
    shuffled.view.col(to) = points_.view.col(order[i]);
    shuffled.source[i] = points_.source[static_cast<std::size_t>(order[i])];
  }
  std::mt19937_64 random(6);
  std::uniform_real_distribution<float> uniform(0, 1);
  for (const ColorFilter filter : {ColorFilter::mono, ColorFilter::bayer_gbrg}) {
    RadianceImage image = lambert(Eigen::Array3d(0.1, 0.2, 0.3), filter), ambient = image;
    for (std::size_t i = 0; i < image.L.size(); ++i) {
      image.L[i] *= 1 + uniform(random);
      ambient.L[i] = 0.01F * uniform(random);
      const float kind = uniform(random);
      if (kind < 0.2F) image.site[i] = RadianceImage::Site::dark;
      if (kind > 0.9F) image.site[i] = RadianceImage::Site::saturated;
      if (uniform(random) > 0.98F) ambient.site[i] = RadianceImage::Site::saturated;
    }
    const BrdfObservations side_by_side = run(image, &ambient);
    const BrdfObservations apart =
        extract(image, &ambient, shuffled, camera_, lamp_, grid_, {}, occluder_, options_);
    EXPECT_EQ(side_by_side.statistics.saturated, apart.statistics.saturated);
    EXPECT_EQ(side_by_side.statistics.dark, apart.statistics.dark);
    EXPECT_EQ(side_by_side.statistics.unlit, apart.statistics.unlit);
    EXPECT_EQ(side_by_side.statistics.grazing, apart.statistics.grazing);
    ASSERT_EQ(side_by_side.rows.size(), apart.rows.size());
    for (std::size_t i = 0; i < apart.rows.size(); ++i) {
      const BrdfObservation &a = side_by_side.rows[i], &b = apart.rows[i];
      EXPECT_EQ(std::tuple(a.cell, a.channel, a.kind, a.count),
                std::tuple(b.cell, b.channel, b.kind, b.count));
      EXPECT_NEAR(a.f, b.f, 1e-12 * a.f);
    }
  }
}

TEST_F(Extract, AccountsForEverySite) {
  const ExtractionStatistics s =
      run(lambert(Eigen::Array3d::Constant(0.2), ColorFilter::mono)).statistics;
  EXPECT_EQ(s.sites, points_.size());
  EXPECT_LT(s.unlit + s.grazing + s.boundary + s.shadowed + s.invalid_cell, s.sites);
  EXPECT_GT(s.unlit, 0);
  EXPECT_EQ(s.shadowed, 0);
}

TEST(ExtractShadows, SeesNoValueInTheShadowOfATorus) {
  const Mesh mesh = make_torus(0.05, 0.02, 1);
  const Occluder occluder(mesh);
  CameraModel camera;
  camera.projection = CameraModel::Projection::orthographic;
  camera.width = camera.height = 150;
  camera.fx = camera.fy = 1000;
  camera.cx = camera.cy = 74.5;
  camera.camera_from_world = look_at({0, 0, 1}, Eigen::Vector3d::Zero(), Eigen::Vector3d::UnitY());
  const SurfacePoints points = points_of_pixels(mesh, occluder, camera, 1);
  const LightPosition light{true, Eigen::Vector3d(1, 0, 0.15).normalized()};
  const std::size_t sites = 150 * 150;
  RadianceImage image{150,
                      150,
                      ColorFilter::mono,
                      std::vector<float>(sites, 0.0F),
                      std::vector<float>(sites, 1e-10F),
                      std::vector<RadianceImage::Site>(sites, RadianceImage::Site::measured)};
  int shadowed = 0;
  for (Eigen::Index i = 0; i < points.size(); ++i) {
    const Eigen::Vector3d n = points.normal.col(i);
    const bool blocked = occluder.blocked(points.position.col(i), n, light);
    shadowed += blocked && n.dot(light.p) > 0;
    const double E = blocked ? 0 : std::max(0.0, n.dot(light.p));
    image.L[static_cast<std::size_t>(points.source[static_cast<std::size_t>(i)])] =
        static_cast<float>(0.3 * E);
  }
  ASSERT_GT(shadowed, 100);
  ExtractOptions options;
  options.limits = no_grazing_limits;
  const BrdfObservations found =
      extract(image, nullptr, points, camera, light, {}, {}, occluder, options);
  EXPECT_GT(found.statistics.shadowed, 100);
  for (const BrdfObservation& row : found.rows) EXPECT_NEAR(row.f, 0.3, 1e-5);
}

}  // namespace
}  // namespace lightrig
