// What little can be seen of a material must not be called more: one light, a plane, a single bin.

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <numbers>
#include <set>

#include "core/brdf_error.h"
#include "core/builtin_materials.h"
#include "core/fit.h"
#include "core/half_diff.h"

namespace lightrig {
namespace {

const BivariateGrid grid{24, 24};

/// The built-in set in five parts, every fifth material unseen.
struct Split {
  BrdfBasis basis;
  std::vector<Material> unseen;
};

const Split& split() {
  static const Split one = [] {
    std::vector<Material> learnt, unseen;
    const std::vector<Material> all = builtin_tables(grid, 4);
    for (std::size_t i = 0; i < all.size(); ++i) (i % 5 == 2 ? unseen : learnt).push_back(all[i]);
    return Split{*make_basis(learnt, {}), std::move(unseen)};
  }();
  return one;
}

/// The largest exponent that an estimate may have.
double brightest(const BrdfBasis& basis) {
  return (basis.y_max + basis.range_slack * (basis.y_max - basis.y_min)).maxCoeff();
}

using Cells = std::set<int>;

/// The cells that points with these normals show.
Cells seen(const std::vector<Eigen::Vector3d>& normals,
           const std::function<Eigen::Vector3d(std::size_t)>& light,
           const std::function<Eigen::Vector3d(std::size_t)>& view) {
  Cells out;
  for (std::size_t i = 0; i < normals.size(); ++i) {
    const Eigen::Vector3d l = light(i), v = view(i);
    if (normals[i].dot(l) < 0.1 || normals[i].dot(v) < 0.1) continue;
    out.insert(cell_of(grid, half_diff(normals[i], l, v)));
  }
  return out;
}

/// One distant light, 50° from the view, on a sphere: θh runs, θd is 25° everywhere.
Cells one_light_on_a_sphere() {
  std::vector<Eigen::Vector3d> normals;
  for (int i = 0; i < 4000; ++i) {
    const double z = 1 - (i + 0.5) / 4000, turn = i * std::numbers::pi * (3 - std::sqrt(5.0));
    normals.emplace_back(std::sqrt(1 - z * z) * std::cos(turn),
                         std::sqrt(1 - z * z) * std::sin(turn), z);
  }
  const double a = 50 * std::numbers::pi / 180;
  return seen(
      normals, [=](std::size_t) { return Eigen::Vector3d(std::sin(a), 0, std::cos(a)); },
      [](std::size_t) { return Eigen::Vector3d(0, 0, 1); });
}

/// One near lamp on a plane of 10 cm seen in perspective: a patch of neighbouring cells.
Cells one_light_on_a_plane() {
  std::vector<Eigen::Vector3d> at;
  for (int x = -10; x <= 10; ++x) {
    for (int y = -10; y <= 10; ++y) at.emplace_back(0.005 * x, 0.005 * y, 0);
  }
  const std::vector<Eigen::Vector3d> normals(at.size(), Eigen::Vector3d::UnitZ());
  const auto towards = [&](const Eigen::Vector3d& p) {
    return [&at, p](std::size_t i) -> Eigen::Vector3d { return (p - at[i]).normalized(); };
  };
  return seen(normals, towards({0.5, 0.1, 0.4}), towards({-0.1, -0.4, 0.6}));
}

BrdfObservations observe(const BrdfTable& truth, const Cells& cells) {
  BrdfObservations out;
  for (int channel = 0; channel < truth.f.cols(); ++channel) {
    for (const int cell : cells) {
      BrdfObservation o;
      o.cell = cell;
      o.channel = static_cast<std::int8_t>(channel);
      o.count = 20;
      o.f = truth.f(cell, channel);
      o.variance = std::pow(0.01 * o.f, 2);
      out.rows.push_back(o);
    }
  }
  return out;
}

struct Case {
  const char* name;
  Cells (*cells)();
  double least_predicted, most_of_the_prior;  ///< [percent]; of what no row at all predicts
};

class Identifiability : public testing::TestWithParam<Case> {};

TEST_P(Identifiability, MapSaysHowLittleItKnowsAndNineInTenTruthsAreWithin) {
  const Split& s = split();
  const Cells cells = GetParam().cells();
  ASSERT_LT(cells.size(), 40U);
  const double nothing = reconstruct(s.basis, fit(s.basis, {}, 3, {})).predicted_error_percent;
  int within = 0, worse = 0;
  double predicted = 0;
  for (const Material& material : s.unseen) {
    const std::vector<BrdfObservations> lights = {observe(material.table, cells)};
    const Reconstruction r = reconstruct(s.basis, fit(s.basis, lights, 3, {}));
    const double error = brdf_error(r.brdf, material.table, 1e-4).percent_log;
    ASSERT_TRUE(std::isfinite(r.predicted_high_percent));
    EXPECT_FALSE(r.brdf.f.log().maxCoeff() > brightest(s.basis) + 1e-9);
    within += error >= r.predicted_low_percent && error <= r.predicted_high_percent;
    worse += error > r.predicted_high_percent;
    predicted += r.predicted_error_percent / static_cast<double>(s.unseen.size());
    EXPECT_GT(r.predicted_high_percent, 1.8 * r.predicted_low_percent);
  }
  const auto n = static_cast<double>(s.unseen.size());
  EXPECT_GE(within, 0.8 * n);
  EXPECT_LE(worse, 0.1 * n);
  EXPECT_GT(predicted, GetParam().least_predicted);
  EXPECT_LT(predicted, GetParam().most_of_the_prior * nothing);
}

TEST_P(Identifiability, ThePseudoInverseSaysThatItsRowsDoNotDetermineIt) {
  const Split& s = split();
  const BrdfBasis paper = truncated(s.basis, 45);
  FitOptions options;
  options.estimator = Estimator::pseudo_inverse;
  const Cells cells = GetParam().cells();
  for (std::size_t i = 0; i < s.unseen.size(); i += 7) {
    const BrdfTable& truth = s.unseen[i].table;
    const Coefficients c = fit(paper, std::vector{observe(truth, cells)}, 3, options);
    EXPECT_LT(c.rank, 45);
    EXPECT_LE(c.rank, static_cast<int>(cells.size()));
    const Reconstruction r = reconstruct(paper, c);
    EXPECT_TRUE(r.brdf.f.isFinite().all());
    // What its exponents would have run to is cut off, and said.
    EXPECT_LE(r.brdf.f.log().maxCoeff(), brightest(paper) + 1e-9);
    EXPECT_GT(r.predicted_error_percent, GetParam().least_predicted);
  }
}

INSTANTIATE_TEST_SUITE_P(Cases, Identifiability,
                         testing::Values(Case{"OneLightOnASphere", one_light_on_a_sphere, 5, 0.5},
                                         Case{"OneLightOnAPlane", one_light_on_a_plane, 10, 0.9},
                                         Case{"ASingleBin", [] { return Cells{grid.cell(6, 12)}; },
                                              15, 0.95}),
                         [](const auto& one) { return std::string(one.param.name); });

}  // namespace
}  // namespace lightrig
