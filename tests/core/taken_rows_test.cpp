#include "core/taken_rows.h"

#include <gtest/gtest.h>

#include <numeric>

#include "core/row_factor.h"
#include "planner_scene.h"

namespace lightrig {
namespace {

PackedRows packed(const Eigen::MatrixXd& G) {
  PackedRows rows;
  rows.k = static_cast<int>(G.cols());
  rows.stride = (rows.k + 7) / 8 * 8;
  rows.data.assign(static_cast<std::size_t>(G.rows() * rows.stride), 0.0);
  for (Eigen::Index r = 0; r < G.rows(); ++r) {
    for (Eigen::Index j = 0; j < G.cols(); ++j) {
      rows.data[static_cast<std::size_t>(r * rows.stride + j)] = G(r, j);
    }
  }
  return rows;
}

TEST(TakenRows, TellTheSameByTheirGramMatrixAsByTheirFactor) {
  const BrdfBasis basis =
      test::random_basis(7, BivariateGrid{20, 8}, ChannelLayout::columns, 1, 13, 0.8);
  const PackedRows rows = packed(basis.V);
  TakenRows taken(rows, vector_level());
  const Eigen::MatrixXd had = 0.5 * basis.V.topRows(30);
  std::vector<std::int32_t> cells(100);
  std::iota(cells.begin(), cells.end(), 30);
  taken.stand_on(had);
  taken.take(cells);
  EXPECT_EQ(taken.count(), 130);
  Eigen::MatrixXd G(130, 13);
  G << had, basis.V.middleRows(30, 100);
  Eigen::VectorXd x = Eigen::VectorXd::Zero(16), y = x;
  x.head(13) = Eigen::VectorXd::LinSpaced(13, -1, 2).normalized();
  y.head(13) = Eigen::VectorXd::LinSpaced(13, 3, 1).normalized();
  const double of_x = (G * x.head(13)).squaredNorm(), of_y = (G * y.head(13)).squaredNorm();
  const std::span<const double> sx(x.data(), 16), sy(y.data(), 16);
  EXPECT_FALSE(taken.factored());
  const TakenRows::Energies by_gram = taken.energies(sx, sy);
  EXPECT_GE(by_gram.of_x, of_x);
  EXPECT_LE(by_gram.of_y, of_y);
  EXPECT_NEAR(by_gram.of_x / of_x, 1, 1e-9);
  EXPECT_NEAR(by_gram.of_y / of_y, 1, 1e-9);
  const Conditioning exact = conditioning_of(singular_values(G), G.rows(), 13);
  const auto plain = conditioning_of_gram(taken.gram(), 13, 16);
  ASSERT_TRUE(plain.has_value());
  EXPECT_NEAR(plain->condition / exact.condition, 1, 1e-11);
  const Conditioning by_factor = conditioning_of_factor(taken.factor(), taken.count());
  EXPECT_TRUE(taken.factored());
  EXPECT_NEAR(by_factor.condition / exact.condition, 1, 1e-11);
  EXPECT_NEAR(taken.energies(sx, sy).of_x / of_x, 1, 1e-12);
}

TEST(TakenRows, GramMatricesThatTellTooLittleAreNotBelieved) {
  // κ² of 1e6, and of rank 12.
  for (const double least : {1e-3, 0.0}) {
    Eigen::MatrixXd G = Eigen::MatrixXd::Identity(13, 13);
    G(12, 12) = least;
    const PackedRows rows = packed(G);
    TakenRows taken(rows, vector_level());
    std::vector<std::int32_t> cells(13);
    std::iota(cells.begin(), cells.end(), 0);
    taken.take(cells);
    EXPECT_FALSE(conditioning_of_gram(taken.gram(), 13, 16).has_value());
    const Conditioning found = conditioning_of_factor(taken.factor(), taken.count());
    EXPECT_EQ(found.rank, least > 0 ? 13 : 12);
  }
}

}  // namespace
}  // namespace lightrig
