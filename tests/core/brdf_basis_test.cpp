#include "core/brdf_basis.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <Eigen/QR>
#include <algorithm>

#include "core/brdf_error.h"
#include "synthetic_materials.h"

namespace lightrig {
namespace {

const BivariateGrid small_grid{12, 10};

BrdfBasis basis_of(const std::vector<Material>& materials, BasisOptions options = {}) {
  Result<BrdfBasis> basis = make_basis(materials, options);
  EXPECT_TRUE(basis.has_value()) << basis.error().message;
  return std::move(*basis);
}

TEST(MakeBasis, HasOrthonormalColumnsAndDescendingDeviations) {
  const BrdfBasis basis = basis_of(synthetic_materials(15, small_grid, 1));
  const Eigen::MatrixXd I = basis.V.transpose() * basis.V;
  EXPECT_LT((I - Eigen::MatrixXd::Identity(I.rows(), I.cols())).cwiseAbs().maxCoeff(), 1e-12);
  EXPECT_EQ(basis.components(), 44);
  EXPECT_TRUE(std::is_sorted(basis.stddev.begin(), basis.stddev.end(), std::greater<>()));
  EXPECT_NEAR(basis.variance_captured, 1, 1e-9);
}

TEST(MakeBasis, SaysAnyTrainingMaterialExactlyInBothLayouts) {
  const std::vector<Material> materials = synthetic_materials(15, small_grid, 2);
  for (const ChannelLayout layout : {ChannelLayout::columns, ChannelLayout::stacked}) {
    BasisOptions options;
    options.layout = layout;
    const BrdfBasis basis = basis_of(materials, options);
    const BrdfTable& truth = materials[4].table;
    Eigen::MatrixXd y(basis.rows(), layout == ChannelLayout::stacked ? 1 : 3);
    for (int channel = 0; channel < 3; ++channel) {
      for (int cell = 0; cell < small_grid.cells(); ++cell) {
        const Eigen::Index row = basis.row(cell, channel);
        y(row, layout == ChannelLayout::stacked ? 0 : channel) =
            map_value(basis.mapping, cell, truth.f(cell, channel)) - basis.mean[row];
      }
    }
    const BrdfTable back = evaluate(basis, basis.V.transpose() * y);
    EXPECT_LT(brdf_error(back, truth, 1e-4).percent_log, 1e-8);
  }
}

TEST(MakeBasis, GivesTheSameBasisTwiceWithFixedSigns) {
  const std::vector<Material> materials = synthetic_materials(9, small_grid, 3);
  const BrdfBasis a = basis_of(materials), b = basis_of(materials);
  EXPECT_TRUE(a.V == b.V);
  for (Eigen::Index i = 0; i < a.components(); ++i) {
    Eigen::Index largest = 0;
    a.V.col(i).cwiseAbs().maxCoeff(&largest);
    EXPECT_GT(a.V(largest, i), 0);
  }
}

TEST(MakeBasis, FindsWhatItCannotSayAsAPlainLeaveMaterialsOutProjectionDoes) {
  const std::vector<Material> materials = synthetic_materials(10, small_grid, 4);
  BasisOptions options;
  options.sigma_folds = 5;
  const BrdfBasis basis = basis_of(materials, options);
  double squares = 0;
  int count = 0;
  for (std::size_t fold = 0; fold < 5; ++fold) {
    std::vector<Material> rest;
    for (std::size_t i = 0; i < 10; ++i) {
      if (i % 5 != fold) rest.push_back(materials[i]);
    }
    BasisOptions plain;
    plain.sigma_folds = 0;
    const BrdfBasis without = basis_of(rest, plain);
    for (std::size_t i = fold; i < 10; i += 5) {
      for (int channel = 0; channel < 3; ++channel) {
        Eigen::VectorXd y(small_grid.cells());
        for (int cell = 0; cell < small_grid.cells(); ++cell) {
          y[cell] = std::log(materials[i].table.f(cell, channel)) - without.mean[cell];
        }
        const Eigen::VectorXd c = without.V.colPivHouseholderQr().solve(y);
        squares += (y - without.V * c).squaredNorm();
        count += small_grid.cells();
      }
    }
  }
  EXPECT_NEAR(basis.unsaid_sigma, std::sqrt(squares / count), 1e-9);
  EXPECT_GT(basis.unsaid_sigma, 0.005);
}

// Two or three materials span little and can teach nothing about a fourth: a fit by them must not
// promise a few per cent.
TEST(MakeBasis, OfTooFewMaterialsTakesTheirScatterForWhatItCannotSay) {
  const std::vector<Material> materials = synthetic_materials(3, small_grid, 7);
  for (const int count : {2, 3}) {
    BasisOptions options;
    options.layout = ChannelLayout::stacked;
    const std::vector<Material> few(materials.begin(), materials.begin() + count);
    const BrdfBasis basis = basis_of(few, options);
    EXPECT_FALSE(basis.left_out);
    // The sample deviation of each row by hand, over all rows (the small grid has no invalid cell).
    double variance = 0;
    for (int cell = 0; cell < small_grid.cells(); ++cell) {
      for (int channel = 0; channel < 3; ++channel) {
        double mean = 0, square = 0;
        for (const Material& m : few) {
          mean += map_value(basis.mapping, cell, m.table.f(cell, channel)) / count;
        }
        for (const Material& m : few) {
          square += std::pow(map_value(basis.mapping, cell, m.table.f(cell, channel)) - mean, 2);
        }
        variance += square / (count - 1) / (3.0 * small_grid.cells());
      }
    }
    EXPECT_NEAR(basis.unsaid_sigma, std::sqrt(variance), 1e-9 * std::sqrt(variance));
    EXPECT_GT(basis.calibration.spread, ErrorCalibration{}.spread);
  }
  EXPECT_TRUE(basis_of(synthetic_materials(15, small_grid, 7)).left_out);
}

TEST(MakeBasis, MasksCellsThatAnyMaterialLacks) {
  std::vector<Material> materials = synthetic_materials(6, small_grid, 5);
  materials[3].table.f(17, 1) = double{NAN};
  const BrdfBasis basis = basis_of(materials);
  EXPECT_EQ(basis.valid[17], 0);
  EXPECT_EQ(std::count(basis.valid.begin(), basis.valid.end(), 0), 1);
  EXPECT_EQ(basis.V.row(17).norm(), 0);
  EXPECT_TRUE(std::isnan(evaluate(basis, Eigen::MatrixXd::Zero(basis.components(), 3)).f(17, 0)));
}

TEST(MakeBasis, ToleratesRepeatedMaterialsByLosingTheirComponents) {
  std::vector<Material> materials = synthetic_materials(6, small_grid, 6);
  materials.push_back(materials[0]);
  materials.push_back(materials[1]);
  const BrdfBasis basis = basis_of(materials);
  EXPECT_EQ(basis.components(), 17);  // 6 × 3 distinct columns less the mean
  BasisOptions more;
  more.components = 20;
  EXPECT_THAT(make_basis(materials, more).error().message, testing::HasSubstr("span only 17"));
}

TEST(MakeBasis, RefusesTooFewMaterialsTooManyComponentsAndMixedGrids) {
  std::vector<Material> materials = synthetic_materials(4, small_grid, 7);
  EXPECT_THAT(make_basis(std::span(materials).first(1), {}).error().message,
              testing::HasSubstr("at least 2 materials"));
  BasisOptions options;
  options.layout = ChannelLayout::stacked;
  options.components = 4;
  EXPECT_THAT(make_basis(materials, options).error().message,
              testing::HasSubstr("support at most 3"));
  materials[2] = synthetic_materials(1, {6, 5}, 8)[0];
  EXPECT_THAT(make_basis(materials, {}).error().message, testing::HasSubstr("different grids"));
}

TEST(Truncated, KeepsTheLeadingComponentsAndOwnsUpToWhatItDropped) {
  const std::vector<Material> materials = synthetic_materials(15, small_grid, 9);
  const BrdfBasis whole = basis_of(materials);
  const BrdfBasis five = truncated(whole, 5);
  EXPECT_TRUE(five.V == whole.V.leftCols(5));
  EXPECT_GT(five.unsaid_sigma, whole.unsaid_sigma);
  BasisOptions options;
  options.components = 5;
  EXPECT_NEAR(five.variance_captured, basis_of(materials, options).variance_captured, 1e-9);
}

TEST(Mapping, EachComesBackAndItsSlopeIsItsDerivative) {
  for (const Mapping kind : {Mapping::ln_floor, Mapping::ln_offset, Mapping::log_relative}) {
    LogMapping mapping{kind, 1e-3, Eigen::ArrayXd::Constant(1, 0.3),
                       Eigen::ArrayXd::Constant(1, 0.07)};
    for (const double f : {2e-3, 0.1, 5.0, 3e4}) {
      EXPECT_NEAR(unmap_value(mapping, 0, map_value(mapping, 0, f)) / f, 1, 1e-12);
      const double h = 1e-5 * f;
      const double slope = (map_value(mapping, 0, f + h) - map_value(mapping, 0, f - h)) / (2 * h);
      EXPECT_NEAR(map_slope(mapping, 0, f) / slope, 1, 1e-8);
    }
    EXPECT_TRUE(std::isfinite(map_value(mapping, 0, 0)));
    EXPECT_TRUE(std::isfinite(map_value(mapping, 0, -1)));
  }
}

TEST(Evaluate, ClipsExponentsToTheTrainingRangeAndCountsThem) {
  const BrdfBasis basis = basis_of(synthetic_materials(8, small_grid, 10));
  Eigen::MatrixXd c = Eigen::MatrixXd::Zero(basis.components(), 3);
  c(0, 1) = 1e6;  // would overflow exp
  int clipped = 0;
  const BrdfTable table = evaluate(basis, c, &clipped);
  EXPECT_GT(clipped, 0);
  EXPECT_TRUE(table.f.isFinite().all());
}

// ln f of six materials that are alike in all but their level: 0, 1, 2, 3, 4, 5.2. Three folds
// leave out {0, 3}, {1, 4} and {2, 5.2}: 0 lies 1 below a range of 1 … 5.2, 5.2 lies 1.2 above one
// of 0 … 4. Of such ranges that is 0.24 and 0.3: the whole, 0 … 5.2, is widened by 0.3 of itself.
TEST(MakeBasis, WidensTheRangeAsMaterialsLeftOutOfTheTrainingNeedIt) {
  std::vector<Material> materials = synthetic_materials(6, small_grid, 5);
  const double level[] = {0, 1, 2, 3, 4, 5.2};
  for (std::size_t m = 0; m < 6; ++m) {
    materials[m].family.clear();
    materials[m].table.f.setConstant(std::exp(level[m]));
  }
  BasisOptions options;
  options.sigma_folds = 3;
  options.components = 1;
  const BrdfBasis basis = basis_of(materials, options);
  EXPECT_NEAR(basis.y_max[17], 5.2, 1e-12);
  EXPECT_NEAR(basis.y_min[17], 0, 1e-12);
  EXPECT_NEAR(basis.range_slack, 0.3, 1e-9);
  const auto brightest = [](const BrdfBasis& b) {
    return std::log(evaluate(b, Eigen::MatrixXd::Constant(1, 1, 1e6)).f(17, 0));
  };
  EXPECT_NEAR(brightest(basis), 5.2 + 0.3 * 5.2, 1e-9);
  options.sigma_folds = 0;
  const BrdfBasis bare = basis_of(materials, options);
  EXPECT_EQ(bare.range_slack, 0);
  EXPECT_NEAR(brightest(bare), 5.2, 1e-12);
}

}  // namespace
}  // namespace lightrig
