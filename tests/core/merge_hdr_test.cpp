#include "core/merge_hdr.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <random>

namespace lightrig {
namespace {

SensorModel test_sensor() {
  SensorModel s;
  s.bits = 12;
  s.gain = 2.5;
  s.black_level = 64;
  s.read_noise = 6;
  s.dark_current = 5;
  s.full_well = 10000;
  s.response = Eigen::Array3d(2000, 2000, 2000);
  s.min_exposure = 1e-5;
  s.max_exposure = 10;
  return s;
}

/// A frame of one radiance everywhere, drawn from Poisson photons, Gaussian read noise, rounding
/// and clipping: written from the physics, not from the merge.
Frame draw(const SensorModel& s, double radiance, double t, int side, std::mt19937_64& random) {
  Frame frame{{side, side, {}}, t, 1};
  std::normal_distribution<double> read(0, s.read_noise);
  for (int i = 0; i < side * side; ++i) {
    const double mean = (radiance * s.response[0] + s.dark_current) * t;
    std::poisson_distribution<long> photons(mean);
    const double electrons =
        std::min(static_cast<double>(mean > 0 ? photons(random) : 0), s.full_well);
    const double counts = std::round(s.black_level + (electrons + read(random)) / s.gain);
    frame.counts.counts.push_back(
        static_cast<std::uint16_t>(std::clamp(counts, 0.0, double(s.white_level()))));
  }
  return frame;
}

struct Moments {
  double mean = 0, stddev = 0, claimed = 0;
  std::size_t n = 0;
};
Moments moments(const RadianceImage& image) {
  Moments m;
  double square = 0;
  for (std::size_t i = 0; i < image.L.size(); ++i) {
    m.mean += double{image.L[i]};
    square += double{image.L[i]} * double{image.L[i]};
    m.claimed += double{image.variance[i]};
  }
  m.n = image.L.size();
  const auto n = static_cast<double>(m.n);
  m.mean /= n;
  m.stddev = std::sqrt(square / n - m.mean * m.mean);
  m.claimed = std::sqrt(m.claimed / n);
  return m;
}

struct Level {
  const char* name;
  double radiance;
};
class MergeHdrLevels : public testing::TestWithParam<Level> {};

TEST_P(MergeHdrLevels, IsUnbiasedAndStatesItsOwnNoise) {
  const SensorModel s = test_sensor();
  std::mt19937_64 random(7);
  const int side = 200;
  std::vector<Frame> bracket;
  for (const double t : {0.002, 0.008, 0.032, 0.128, 0.512}) {
    bracket.push_back(draw(s, GetParam().radiance, t, side, random));
  }
  const auto image = merge_hdr(bracket, {}, s, {});
  ASSERT_TRUE(image.has_value());
  const Moments m = moments(*image);
  const double standard_error = m.stddev / std::sqrt(static_cast<double>(m.n));
  EXPECT_NEAR(m.mean, GetParam().radiance, 4 * standard_error + 1e-6 * GetParam().radiance);
  EXPECT_NEAR(m.claimed / m.stddev, 1, 0.05);
}
INSTANTIATE_TEST_SUITE_P(Levels, MergeHdrLevels,
                         testing::Values(Level{"AtNoLight", 0.0}, Level{"AtOneElectron", 0.001},
                                         Level{"AtAHundredElectrons", 0.1}, Level{"MidScale", 3.0},
                                         Level{"InTheShortestOnly", 900.0}),
                         [](const auto& level) { return std::string(level.param.name); });

TEST(MergeHdr, ReachesTheCramerRaoBoundAtAHundredElectronsPerSecond) {
  SensorModel s = test_sensor();
  s.dark_current = 0;
  std::mt19937_64 random(8);
  std::vector<Frame> bracket;
  double information = 0;  // of the rate: Σ t²/(φt + rn² + q²/12)
  const double rate = 100;
  for (const double t : {0.01, 0.04, 0.16, 0.64, 2.56}) {
    bracket.push_back(draw(s, rate / s.response[0], t, 200, random));
    information += t * t / (rate * t + s.read_noise * s.read_noise + s.gain * s.gain / 12);
  }
  const auto image = merge_hdr(bracket, {}, s, {});
  ASSERT_TRUE(image.has_value());
  const double bound = 1 / std::sqrt(information) / s.response[0];
  EXPECT_NEAR(moments(*image).stddev / bound, 1, 0.02);
}

TEST(MergeHdr, MarksASiteThatEvenTheShortestExposureFillsAndInventsNothing) {
  const SensorModel s = test_sensor();
  std::mt19937_64 random(9);
  const double radiance = 1e5;  // 2e8 e/s: 400,000 e in 2 ms against a full well of 10,000
  const std::vector<Frame> bracket = {draw(s, radiance, 0.002, 4, random),
                                      draw(s, radiance, 0.02, 4, random)};
  const auto image = merge_hdr(bracket, {}, s, {});
  ASSERT_TRUE(image.has_value());
  for (std::size_t i = 0; i < image->L.size(); ++i) {
    EXPECT_EQ(image->site[i], RadianceImage::Site::saturated);
    EXPECT_TRUE(std::isinf(image->variance[i]));
    EXPECT_LT(double{image->L[i]}, radiance);  // a lower bound
    EXPECT_NEAR(double{image->L[i]}, 0.98 * 10000 / 0.002 / 2000, 1);
  }
}

TEST(MergeHdr, SubtractsDarkFramesOfEqualExposureEvenWhereTheModelIsWrong) {
  const SensorModel s = test_sensor();
  std::mt19937_64 random(10);
  SensorModel hot = s;
  hot.dark_current = 800;  // a warm sensor the rig file knows nothing of
  hot.black_level = 70;
  std::vector<Frame> bracket, dark;
  for (const double t : {0.05, 0.5}) {
    bracket.push_back(draw(hot, 0.4, t, 150, random));
    for (int i = 0; i < 16; ++i) dark.push_back(draw(hot, 0, t, 150, random));
  }
  const auto without = merge_hdr(bracket, {}, s, {});
  const auto with = merge_hdr(bracket, dark, s, {});
  ASSERT_TRUE(with.has_value() && without.has_value());
  EXPECT_NEAR(moments(*with).mean, 0.4, 0.002);
  EXPECT_GT(moments(*without).mean, 0.6);
}

TEST(MergeHdr, GivesTheSameImageOnAnyNumberOfThreads) {
  const SensorModel s = test_sensor();
  std::mt19937_64 random(11);
  const std::vector<Frame> bracket = {draw(s, 1, 0.01, 61, random), draw(s, 1, 0.1, 61, random)};
  MergeOptions one, three;
  three.threads = 3;
  EXPECT_EQ(merge_hdr(bracket, {}, s, one)->L, merge_hdr(bracket, {}, s, three)->L);
}

TEST(MergeHdr, MergesTheSpansItIsGivenAsAnyOtherAndSaysNothingOfTheRest) {
  const SensorModel s = test_sensor();
  std::mt19937_64 random(12);
  const std::vector<Frame> bracket = {draw(s, 1, 0.01, 61, random), draw(s, 1, 0.1, 61, random)};
  // An empty row, one site, a row's both ends, and several in no order.
  const std::vector<std::int32_t> sites{61 + 5, 2 * 61, 2 * 61 + 60, 4 * 61 + 9, 4 * 61 + 3};
  const RowSpans spans = spans_of_sites(sites, 61, 61);
  EXPECT_EQ(spans.begin[0], spans.end[0]);
  MergeOptions some;
  some.spans = &spans;
  some.threads = 2;
  const RadianceImage all = *merge_hdr(bracket, {}, s, {}), part = *merge_hdr(bracket, {}, s, some);
  int merged = 0;
  for (int i = 0; i < 61 * 61; ++i) {
    const int row = i / 61, column = i % 61;
    const bool inside = row == 1   ? column == 5
                        : row == 2 ? true
                                   : row == 4 && column >= 3 && column <= 9;
    const auto at = static_cast<std::size_t>(i);
    merged += inside ? 1 : 0;
    EXPECT_EQ(part.L[at], inside ? all.L[at] : 0.0F) << row << ", " << column;
    EXPECT_EQ(part.site[at], inside ? all.site[at] : RadianceImage::Site::saturated);
    EXPECT_EQ(part.variance[at], inside ? all.variance[at] : HUGE_VALF);
  }
  EXPECT_EQ(merged, 1 + 61 + 7);
}

TEST(MergeHdr, SurvivesExposureRatiosOfAMillion) {
  const SensorModel s = test_sensor();
  std::mt19937_64 random(12);
  std::vector<Frame> bracket;
  for (const double t : {1e-5, 1e-2, 10.0}) bracket.push_back(draw(s, 0.05, t, 50, random));
  const auto image = merge_hdr(bracket, {}, s, {});
  ASSERT_TRUE(image.has_value());
  EXPECT_NEAR(moments(*image).mean, 0.05, 0.0005);
}

TEST(MergeHdr, RefusesFramesThatCannotBelongTogetherAndSaysWhich) {
  const SensorModel s = test_sensor();
  std::mt19937_64 random(13);
  Frame a = draw(s, 1, 0.01, 4, random), b = draw(s, 1, 0.1, 5, random);
  EXPECT_THAT(merge_hdr(std::vector{a, b}, {}, s, {}).error().message,
              testing::HasSubstr("bracket frame 1 is 5 × 5"));
  b = a;
  b.exposure = 0;
  EXPECT_THAT(merge_hdr(std::vector{a, b}, {}, s, {}).error().message,
              testing::HasSubstr("exposed for 0 s"));
  EXPECT_THAT(merge_hdr({}, {}, s, {}).error().message, testing::HasSubstr("0 frames given"));
}

TEST(ChannelAt, FollowsTheFourBayerOrders) {
  EXPECT_EQ(channel_at(ColorFilter::bayer_rggb, 0, 0), 0);
  EXPECT_EQ(channel_at(ColorFilter::bayer_rggb, 3, 3), 2);
  EXPECT_EQ(channel_at(ColorFilter::bayer_grbg, 0, 1), 0);
  EXPECT_EQ(channel_at(ColorFilter::bayer_grbg, 1, 0), 2);
  EXPECT_EQ(channel_at(ColorFilter::bayer_gbrg, 0, 1), 2);
  EXPECT_EQ(channel_at(ColorFilter::bayer_gbrg, 1, 0), 0);
  EXPECT_EQ(channel_at(ColorFilter::bayer_bggr, 0, 0), 2);
  EXPECT_EQ(channel_at(ColorFilter::bayer_bggr, 1, 1), 0);
  for (const ColorFilter f : {ColorFilter::bayer_rggb, ColorFilter::bayer_grbg,
                              ColorFilter::bayer_gbrg, ColorFilter::bayer_bggr}) {
    int sites[3] = {0, 0, 0};
    for (int i = 0; i < 4; ++i) ++sites[channel_at(f, i / 2, i % 2)];
    EXPECT_THAT(sites, testing::ElementsAre(1, 2, 1));
  }
  EXPECT_EQ(channel_at(ColorFilter::mono, 5, 7), 0);
}

/// A metering frame with sites of the given electron rates [e⁻/s].
Frame metered(const SensorModel& s, double t, const std::vector<double>& rates) {
  Frame frame{{static_cast<int>(rates.size()), 1, {}}, t, 1};
  for (const double rate : rates) {
    const double counts = s.black_level + std::min((rate + s.dark_current) * t / s.gain, 4031.0);
    frame.counts.counts.push_back(static_cast<std::uint16_t>(std::lround(counts)));
  }
  return frame;
}

TEST(ChooseExposures, SkipsWhatTheSceneDoesNotNeedOnBothSides) {
  const SensorModel s = test_sensor();
  const std::vector<double> offered = {0.001, 0.004, 0.016, 0.064, 0.256, 1.024};
  // The brightest site, 1e5 e/s, fills 6,400 e in 64 ms and is full in 256 ms. The darkest, 6e4
  // e/s, reaches an SNR of 50 (2,500 e) in 64 ms.
  const auto choice = choose_exposures(metered(s, 0.016, {1e5, 8e4, 6e4}),
                                       std::vector<std::uint8_t>{1, 1, 1}, offered, s, 50);
  EXPECT_THAT(choice.exposures, testing::ElementsAre(0.064));
  EXPECT_EQ(choice.skipped.size(), 5U);
}

TEST(ChooseExposures, KeepsTheShortestWhenTheMeteringFrameItselfIsFull) {
  const SensorModel s = test_sensor();
  const std::vector<double> offered = {0.001, 0.004, 0.016, 0.064};
  const auto choice = choose_exposures(metered(s, 0.016, {1e9, 5e4}),
                                       std::vector<std::uint8_t>{1, 1}, offered, s, 20);
  EXPECT_EQ(choice.exposures.front(), 0.001);
}

TEST(ChooseExposures, LooksAtLitSitesOnly) {
  const SensorModel s = test_sensor();
  const std::vector<double> offered = {0.001, 0.01, 0.1};
  const auto choice = choose_exposures(metered(s, 0.01, {1e9, 5e4}),
                                       std::vector<std::uint8_t>{0, 1}, offered, s, 50);
  EXPECT_THAT(choice.exposures, testing::ElementsAre(0.1));
  EXPECT_NEAR(choice.brightest, 5e4, 500);
}

}  // namespace
}  // namespace lightrig
