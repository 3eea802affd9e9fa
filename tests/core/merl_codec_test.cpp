#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <limits>
#include <numbers>

#include "core/brdf_error.h"
#include "core/brdf_table.h"

namespace lightrig {
namespace {

std::vector<std::byte> merl_bytes(std::array<std::int32_t, 3> n,
                                  const std::vector<double>& values) {
  std::vector<std::byte> bytes(12 + values.size() * 8);
  std::memcpy(bytes.data(), n.data(), 12);
  if (!values.empty()) std::memcpy(bytes.data() + 12, values.data(), values.size() * 8);
  return bytes;
}

TEST(DecodeMerl, ScalesTheThreeChannelsAsMerlDoes) {
  MerlFindings findings;
  const auto table = decode_merl(merl_bytes({1, 1, 1}, {1500, 1500, 1500}), findings);
  ASSERT_TRUE(table.has_value());
  EXPECT_DOUBLE_EQ(table->f[0], 1.0);
  EXPECT_DOUBLE_EQ(table->f[1], 1.15);
  EXPECT_DOUBLE_EQ(table->f[2], 1.66);
}

TEST(DecodeMerl, CountsAndMarksWhatIsNotAReflectance) {
  MerlFindings findings;
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const double inf = std::numeric_limits<double>::infinity();
  const auto table = decode_merl(merl_bytes({2, 1, 1}, {-1, 2, nan, inf, -3, 0}), findings);
  ASSERT_TRUE(table.has_value());
  EXPECT_EQ(findings.negative, 2U);
  EXPECT_EQ(findings.not_a_number, 2U);
  EXPECT_TRUE(std::isnan(table->f[0]) && std::isnan(table->f[2]) && std::isnan(table->f[3]));
  EXPECT_EQ(table->f[5], 0.0);
}

TEST(DecodeMerl, RefusesAFileThatIsTooShortTooLongOrAbsurdAndSaysWhy) {
  MerlFindings findings;
  const auto message = [&](const std::vector<std::byte>& bytes) {
    const auto table = decode_merl(bytes, findings);
    return table ? std::string() : table.error().message;
  };
  EXPECT_THAT(message(merl_bytes({2, 1, 1}, {1, 2, 3})), testing::HasSubstr("truncated: 36 bytes"));
  EXPECT_THAT(message(merl_bytes({1, 1, 1}, {1, 2, 3, 4})), testing::HasSubstr("too long"));
  EXPECT_THAT(message(merl_bytes({0, 90, 180}, {})), testing::HasSubstr("absurd MERL header"));
  EXPECT_THAT(message(merl_bytes({-90, -90, 180}, {})), testing::HasSubstr("absurd"));
  EXPECT_THAT(message(merl_bytes({2147483647, 2147483647, 2147483647}, {})),
              testing::HasSubstr("absurd"));
  EXPECT_THAT(message({}), testing::HasSubstr("not a MERL file: 0 bytes"));
}

TEST(EncodeMerl, ComesBackFromItsBytesWithInvalidCellsInvalid) {
  MerlTable table{3, 2, 4, {}};
  for (int i = 0; i < 3 * 24; ++i) table.f.push_back(i % 7 == 0 ? double{NAN} : 0.01 * i);
  MerlFindings findings;
  const auto back = decode_merl(encode_merl(table), findings);
  ASSERT_TRUE(back.has_value());
  EXPECT_EQ(back->n_phi, 4);
  for (std::size_t i = 0; i < table.f.size(); ++i) {
    if (std::isnan(table.f[i])) {
      EXPECT_TRUE(std::isnan(back->f[i]));
    } else {
      EXPECT_NEAR(back->f[i], table.f[i], 1e-15);
    }
  }
}

TEST(ToBivariate, AveragesOverTheSlicesThatLieAboveTheHorizonOnly) {
  // Below the horizon a constant 1 is replaced by 1e6: any such slice would show in the mean.
  const BivariateGrid grid{90, 90};
  const int n_phi = 180;
  MerlTable table{90, 90, n_phi, std::vector<double>(3 * 90 * 90 * 180, 1.0)};
  for (int cell = 0; cell < grid.cells(); ++cell) {
    for (int i = 0; i < n_phi; ++i) {
      HalfDiff angles = cell_centre(grid, cell);
      angles.phi_d = (i + 0.5) * std::numbers::pi / n_phi;
      const DirectionPair pair = directions(angles);
      if (pair.wi.z() <= -1e-9 || pair.wo.z() <= -1e-9) {
        for (int channel = 0; channel < 3; ++channel) {
          table
              .f[(static_cast<std::size_t>(channel) * 8100 + static_cast<std::size_t>(cell)) * 180 +
                 static_cast<std::size_t>(i)] = 1e6;
        }
      }
    }
  }
  const BrdfTable mean = to_bivariate(table);
  int with_value = 0;
  for (int cell = 0; cell < grid.cells(); ++cell) {
    for (int channel = 0; channel < 3; ++channel) {
      const double f = mean.f(cell, channel);
      if (std::isnan(f)) continue;
      EXPECT_NEAR(f, 1.0, 1e-12) << cell;
      ++with_value;
    }
  }
  EXPECT_GT(with_value, 3 * 7500);  // of 3 · 8100: only near the edge is no slice above the horizon
}

TEST(ToMerl, GivesBackTheBivariateTableItCameFrom) {
  BrdfTable table{{30, 20}, Eigen::ArrayXXd(600, 3)};
  for (int i = 0; i < table.f.size(); ++i) table.f.data()[i] = 0.001 * (i % 997);
  const BrdfTable back = to_bivariate(to_merl(table, 180));
  int compared = 0;
  for (int i = 0; i < table.f.size(); ++i) {
    if (std::isnan(back.f.data()[i])) continue;  // no slice above the horizon
    EXPECT_NEAR(back.f.data()[i], table.f.data()[i], 1e-12);
    ++compared;
  }
  EXPECT_GT(compared, 1700);
}

TEST(Tabulate, OfAConstantIsThatConstant) {
  const BrdfTable table =
      tabulate([](const HalfDiff&) { return Eigen::Array3d(0.1, 0.2, 0.3); }, {90, 90}, 24);
  int valid = 0;
  for (int cell = 0; cell < 8100; ++cell) {
    if (std::isnan(table.f(cell, 0))) continue;
    ++valid;
    EXPECT_NEAR(table.f(cell, 1), 0.2, 1e-15);
  }
  EXPECT_GT(valid, 7500);
}

TEST(BrdfError, OfATableAgainstItselfIsZero) {
  BrdfTable table{{10, 10}, Eigen::ArrayXXd::Constant(100, 3, 0.3)};
  const BrdfError error = brdf_error(table, table, 1e-4);
  EXPECT_EQ(error.percent_log, 0);
  EXPECT_EQ(error.percent_linear_cos, 0);
  EXPECT_EQ(error.cells, 300);
}

TEST(BrdfError, OfAFactorEOnAConstantOfEToTheMinusTwoIsFiftyPercent) {
  const BrdfTable truth{{10, 10}, Eigen::ArrayXXd::Constant(100, 1, std::exp(-2.0))};
  BrdfTable estimate = truth;
  estimate.f *= std::exp(1.0);
  const BrdfError error = brdf_error(estimate, truth, 1e-4);
  EXPECT_NEAR(error.percent_log, 50, 1e-10);             // ‖1‖/‖2‖
  EXPECT_NEAR(error.percent_linear_cos, 171.828, 1e-3);  // e − 1
  EXPECT_NEAR(error.median_abs_log, 1, 1e-12);
}

TEST(BrdfError, LeavesOutCellsThatEitherLacks) {
  BrdfTable truth{{2, 2}, Eigen::ArrayXXd::Constant(4, 1, 0.1)};
  BrdfTable estimate = truth;
  truth.f(0, 0) = double{NAN};
  estimate.f(1, 0) = double{NAN};
  EXPECT_EQ(brdf_error(estimate, truth, 1e-4).cells, 2);
}

}  // namespace
}  // namespace lightrig
