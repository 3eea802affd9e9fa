#include "sim/philox.h"

#include <gtest/gtest.h>

#include <cmath>
#include <set>
#include <vector>

namespace lightrig::sim {
namespace {

TEST(Philox, GivesThePublishedKnownAnswers) {
  // Random123's kat_vectors for philox4x32, 10 rounds [Salmon et al. 2011].
  EXPECT_EQ(philox({0, 0, 0, 0}, {0, 0}),
            (PhiloxCounter{0x6627e8d5, 0xe169c58d, 0xbc57ac4c, 0x9b00dbd8}));
  EXPECT_EQ(philox({0xffffffff, 0xffffffff, 0xffffffff, 0xffffffff}, {0xffffffff, 0xffffffff}),
            (PhiloxCounter{0x408f276d, 0x41c83b0e, 0xa20bc7c6, 0x6d5451fd}));
  EXPECT_EQ(philox({0x243f6a88, 0x85a308d3, 0x13198a2e, 0x03707344}, {0xa4093822, 0x299f31d0}),
            (PhiloxCounter{0xd16cfe09, 0x94fdcceb, 0x5001e420, 0x24126ea1}));
}

TEST(Philox, EveryWordChangesTheDerivedKey) {
  std::set<PhiloxKey> keys;
  for (std::uint64_t seed = 0; seed < 10; ++seed) {
    for (std::uint64_t a = 0; a < 10; ++a) {
      for (std::uint64_t b = 0; b < 10; ++b) {
        keys.insert(derive_key(seed, std::vector<std::uint64_t>{a, b}));
        keys.insert(derive_key(seed, std::vector<std::uint64_t>{a, b << 40}));
      }
    }
  }
  EXPECT_EQ(keys.size(), 1900U);  // b = 0 twice
}

TEST(UniformOpen, IsNeverZeroOrOne) {
  EXPECT_GT(uniform_open(0, 0), 0);
  EXPECT_LT(uniform_open(0xffffffff, 0xffffffff), 1);
}

struct Moments {
  double mean = 0, variance = 0, third = 0;
};

template <class Draw>
Moments moments(int count, const Draw& draw) {
  std::vector<double> values(static_cast<std::size_t>(count));
  Moments m;
  for (int i = 0; i < count; ++i) {
    values[static_cast<std::size_t>(i)] = draw(static_cast<std::uint32_t>(i));
    m.mean += values[static_cast<std::size_t>(i)] / count;
  }
  for (const double x : values) {
    m.variance += (x - m.mean) * (x - m.mean) / (count - 1);
    m.third += std::pow(x - m.mean, 3) / count;
  }
  return m;
}

TEST(Poisson, HasItsMeanItsVarianceAndItsSkewAtEveryLevel) {
  constexpr int count = 200000;
  std::uint64_t seed = 1;
  for (const double mean : {0.01, 0.7, 4.0, 9.999, 10.0, 35.0, 1000.0, 2.5e5, 1e9}) {
    const PhiloxKey key = derive_key(++seed, {});
    const Moments m = moments(count, [&](std::uint32_t i) { return poisson(mean, i, key); });
    // Five standard errors of each statistic of a Poisson distribution.
    EXPECT_NEAR(m.mean, mean, 5 * std::sqrt(mean / count)) << mean;
    EXPECT_NEAR(m.variance, mean, 5 * std::sqrt((2 * mean * mean + mean) / count)) << mean;
    const double sixth = 15 * mean * mean * mean + 25 * mean * mean + mean;
    EXPECT_NEAR(m.third, mean, 5 * std::sqrt(sixth / count)) << mean;
  }
}

TEST(Poisson, ItsHistogramPassesAChiSquareTestOnBothSidesOfTheMethodsBoundary) {
  constexpr int count = 400000;
  for (const double mean : {3.0, 9.9, 10.1, 40.0}) {
    const PhiloxKey key = derive_key(77, {});
    std::vector<int> seen(200, 0);
    for (std::uint32_t i = 0; i < count; ++i) {
      ++seen[static_cast<std::size_t>(std::min(199.0, poisson(mean, i, key)))];
    }
    double chi_square = 0, probability = std::exp(-mean);
    int degrees = -1;
    for (int k = 0; k < 199; ++k) {
      const double expected = count * probability;
      if (expected > 10) {
        chi_square += std::pow(seen[static_cast<std::size_t>(k)] - expected, 2) / expected;
        ++degrees;
      }
      probability *= mean / (k + 1);
    }
    EXPECT_LT(chi_square, degrees + 5 * std::sqrt(2.0 * degrees)) << mean;
    EXPECT_GT(chi_square, degrees - 5 * std::sqrt(2.0 * degrees)) << mean;
  }
}

TEST(StandardNormal, HasTheMomentsAndTailsOfANormal) {
  constexpr int count = 400000;
  const PhiloxKey key = derive_key(5, {});
  const Moments m = moments(count, [&](std::uint32_t i) { return standard_normal(i, key); });
  EXPECT_NEAR(m.mean, 0, 5 / std::sqrt(count));
  EXPECT_NEAR(m.variance, 1, 5 * std::sqrt(2.0 / count));
  EXPECT_NEAR(m.third, 0, 5 * std::sqrt(15.0 / count));
  int beyond_three = 0;
  for (std::uint32_t i = 0; i < count; ++i) beyond_three += std::abs(standard_normal(i, key)) > 3;
  const double expected = count * 0.0026997960632601866;  // erfc(3/√2)
  EXPECT_NEAR(beyond_three, expected, 5 * std::sqrt(expected));
}

}  // namespace
}  // namespace lightrig::sim
