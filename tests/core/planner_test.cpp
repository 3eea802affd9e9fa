#include "core/planner.h"

#include <gtest/gtest.h>

#include <cmath>

#include "core/svd.h"

#include "planner_scene.h"

namespace lightrig {
namespace {

/// A basis on a 3 × 1 grid, one row per cell: three orthonormal components of known size.
BrdfBasis three_cells() {
  BrdfBasis basis;
  basis.grid = {3, 1};
  basis.layout = ChannelLayout::columns;
  basis.valid = {1, 1, 1};
  basis.mean = Eigen::Vector3d(-2, -1, -2);
  basis.V = Eigen::Matrix3d::Identity();
  basis.stddev = Eigen::Vector3d(3, 2, 1);
  return basis;
}

CandidateBins bins_of(BivariateGrid grid, const std::vector<std::vector<std::int32_t>>& cells) {
  CandidateBins bins;
  bins.grid = grid;
  bins.offset.push_back(0);
  for (const auto& one : cells) {
    bins.cell.insert(bins.cell.end(), one.begin(), one.end());
    bins.offset.push_back(static_cast<std::int64_t>(bins.cell.size()));
  }
  return bins;
}

TEST(SelectLights, TakesLargerRankFirstAndStopsWhenNothingIsNew) {
  const BrdfBasis basis = three_cells();
  const CandidateBins bins = bins_of(basis.grid, {{0}, {}, {0, 1}, {0, 1}, {2}, {1}});
  for (const bool brute : {true, false}) {
    SelectionOptions options;
    options.stop = StopRule::count;
    options.brute_force = brute;
    const Selection selection = select_lights(basis, bins, options);
    ASSERT_EQ(selection.lights.size(), 2U);
    EXPECT_EQ(selection.lights[0].candidate, 2);
    EXPECT_EQ(selection.lights[0].rank, 2);
    EXPECT_TRUE(std::isinf(selection.lights[0].condition));
    EXPECT_EQ(selection.lights[1].candidate, 4);
    EXPECT_EQ(selection.lights[1].rank, 3);
    EXPECT_NEAR(selection.lights[1].condition, 1, 1e-12);
    EXPECT_EQ(selection.lights[1].new_cells, 1);
  }
}

TEST(SelectLights, AOptimalTakesWhatRemovesMostVariance) {
  const BrdfBasis basis = three_cells();
  const CandidateBins bins = bins_of(basis.grid, {{2}, {1}, {0}});
  for (const bool brute : {true, false}) {
    SelectionOptions options;
    options.criterion = Criterion::a_optimal;
    options.stop = StopRule::count;
    options.sigma = 1;
    options.brute_force = brute;
    const Selection selection = select_lights(basis, bins, options);
    ASSERT_EQ(selection.lights.size(), 3U);
    // One row turns a prior variance s² into s²/(1 + s²): 9 → 0.9, 4 → 0.8, 1 → 0.5.
    EXPECT_EQ(selection.lights[0].candidate, 2);
    EXPECT_NEAR(selection.lights[0].score, 0.9 + 4 + 1, 1e-12);
    EXPECT_EQ(selection.lights[1].candidate, 1);
    EXPECT_NEAR(selection.lights[1].score, 0.9 + 0.8 + 1, 1e-12);
    EXPECT_NEAR(selection.lights[2].score, 0.9 + 0.8 + 0.5, 1e-12);
    EXPECT_EQ(selection.lights[0].rank, 1);
    EXPECT_GT(selection.mean_only_error_percent, selection.lights[0].predicted_error_percent);
  }
}

TEST(SelectLights, LightsCapturedAlreadyStandAndExcludedOnesAreNotTaken) {
  const BrdfBasis basis = three_cells();
  const CandidateBins bins = bins_of(basis.grid, {{0}, {0, 1}, {1}, {2}, {2}});
  for (const bool brute : {true, false}) {
    SelectionOptions options;
    options.stop = StopRule::count;
    options.already = {0};
    options.excluded = {0, 1, 0, 1, 0};
    options.brute_force = brute;
    const Selection selection = select_lights(basis, bins, options);
    ASSERT_EQ(selection.lights.size(), 2U);
    EXPECT_EQ(selection.lights[0].candidate, 2);
    EXPECT_EQ(selection.lights[0].rank, 2);
    EXPECT_EQ(selection.lights[1].candidate, 4);
  }
}

TEST(Conditioning, IsTheSquaredRatioOfSingularValues) {
  const BivariateGrid grid{12, 4};
  const BrdfBasis basis = test::random_basis(7, grid, ChannelLayout::stacked, 3, 9, 0.8);
  const CandidateBins bins = bins_of(grid, {{0, 4, 8, 12}, {3, 4, 17, 29}, {}});
  const std::vector<int> both = {0, 1}, none = {2};
  const Conditioning found = conditioning(basis, bins, both);
  Eigen::MatrixXd G(21, 9);
  Eigen::Index row = 0;
  for (const int cell : {0, 3, 4, 8, 12, 17, 29}) {
    for (int c = 0; c < 3; ++c) G.row(row++) = basis.V.row(c * grid.cells() + cell);
  }
  const Eigen::VectorXd s = right_singular(G).values;
  EXPECT_EQ(found.rank, 9);
  EXPECT_NEAR(found.condition / std::pow(s[0] / s[8], 2), 1, 1e-10);
  EXPECT_EQ(conditioning(basis, bins, none).rank, 0);
  EXPECT_TRUE(std::isinf(conditioning(basis, bins, none).condition));
}

}  // namespace
}  // namespace lightrig
