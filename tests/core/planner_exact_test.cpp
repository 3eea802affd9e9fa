// The fast choosers against the plain reference: the same lights, and scores within 1e-9.

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>

#include "core/fit.h"
#include "core/planner.h"
#include "core/planner_kernels.h"
#include "core/planner_rows.h"
#include "core/surface_points.h"
#include "planner_scene.h"

namespace lightrig {
namespace {

::testing::AssertionResult same(const Selection& fast, const Selection& plain) {
  if (fast.lights.size() != plain.lights.size()) {
    return ::testing::AssertionFailure()
           << fast.lights.size() << " lights against " << plain.lights.size();
  }
  for (std::size_t i = 0; i < fast.lights.size(); ++i) {
    const SelectedLight &f = fast.lights[i], &p = plain.lights[i];
    if (f.candidate != p.candidate || f.rank != p.rank || f.new_cells != p.new_cells) {
      return ::testing::AssertionFailure()
             << "light " << i << ": candidate " << f.candidate << " rank " << f.rank << " score "
             << f.score << " against " << p.candidate << " rank " << p.rank << " score " << p.score;
    }
    const double tolerance = std::max(1e-9, 1e-15 * std::sqrt(p.score));
    if (!(std::abs(f.score / p.score - 1) <= tolerance)) {
      return ::testing::AssertionFailure()
             << "light " << i << ": score " << f.score << " against " << p.score;
    }
    if (f.score < 0 || std::isnan(f.condition) || f.condition < 1) {
      return ::testing::AssertionFailure() << "light " << i << ": condition " << f.condition;
    }
  }
  if (fast.plateau_reached != plain.plateau_reached)
    return ::testing::AssertionFailure() << "plateau";
  return ::testing::AssertionSuccess();
}

struct SmallProblem {
  BrdfBasis basis;
  CandidateBins bins;
  SelectionOptions options;
};

SmallProblem small_problem(std::uint64_t seed) {
  SmallProblem problem;
  const BivariateGrid grid{8 + static_cast<int>(seed % 7), 3 + static_cast<int>(seed % 5)};
  const bool stacked = seed % 3 == 0;
  const Eigen::Index k = 2 + static_cast<Eigen::Index>(seed % 13);
  const double fall = std::array{0.9, 0.6, 0.3}[seed / 5 % 3];
  problem.basis =
      test::random_basis(seed, grid, stacked ? ChannelLayout::stacked : ChannelLayout::columns,
                         stacked ? 3 : 1, k, fall);
  problem.bins = test::random_bins(seed + 1, grid, 5 + static_cast<int>(seed % 40), seed % 2 == 0);
  problem.options.criterion = seed / 2 % 2 == 0 ? Criterion::condition : Criterion::a_optimal;
  problem.options.stop =
      std::array{StopRule::count, StopRule::literal, StopRule::plateau}[seed % 3];
  problem.options.max_lights = 6;
  if (seed % 4 == 1) problem.options.already = {0, 3};
  if (seed % 6 == 1) {
    problem.options.excluded.assign(static_cast<std::size_t>(problem.bins.candidates()), 0);
    problem.options.excluded[1] = problem.options.excluded[4] = 1;
  }
  return problem;
}

TEST(SelectLights, EqualsBruteForceOnAThousandSeededSmallProblems) {
  std::int64_t exact_fast = 0, exact_plain = 0;
  for (std::uint64_t seed = 0; seed < 1000; ++seed) {
    SmallProblem problem = small_problem(seed);
    const Selection fast = select_lights(problem.basis, problem.bins, problem.options);
    problem.options.brute_force = true;
    const Selection plain = select_lights(problem.basis, problem.bins, problem.options);
    ASSERT_TRUE(same(fast, plain)) << "seed " << seed;
    exact_fast += fast.statistics.exact_evaluations;
    exact_plain += plain.statistics.exact_evaluations;
  }
  EXPECT_LT(exact_fast, exact_plain / 2);
}

/// A scene of the data folder, or the sphere, binned twice: with the rays needed, and for brute
/// force with one for every lit point.
struct SceneBins {
  CandidateBins fast, plain;
};
SceneBins bins_of_scene(const std::string& mesh_name, const std::string& folder,
                        const BrdfBasis& basis, bool distant, bool pixels, int candidates) {
  const Mesh mesh =
      mesh_name == "sphere" ? test::sphere_mesh(5) : test::data_mesh(folder, mesh_name);
  const Occluder occluder(mesh);
  const CameraModel camera = test::facing_camera(distant, 4, 120, 120);
  const SurfacePoints points = pixels ? points_of_pixels(mesh, occluder, camera, 1)
                                      : points_of_vertices(mesh, occluder, camera);
  const auto lights = test::spread_lights(candidates, distant, 3);
  const auto bins = [&](ShadowRays rays, int threads) {
    return bin_candidates(points, lights, basis.grid, basis.valid, no_grazing_limits, occluder,
                          rays, threads)
        .bins;
  };
  return {bins(ShadowRays::needed, 2), bins(ShadowRays::all, 1)};
}

bool equal(const SceneBins& bins) {
  return bins.fast.offset == bins.plain.offset && bins.fast.cell == bins.plain.cell;
}

struct Case {
  const char* mesh;
  ChannelLayout layout;
  Eigen::Index k;
  bool distant, pixels;
  Criterion criterion;
  int candidates, lights;
};

TEST(SelectLights, EqualsBruteForceOnTheMeshesAndMaterialsOfTheDataFolder) {
  const auto folder = test::data_folder();
  if (!folder) GTEST_SKIP() << "no data folder (LIGHTRIG_DATA, ../shared/data)";
  constexpr auto stacked = ChannelLayout::stacked, columns = ChannelLayout::columns;
  constexpr auto kappa = Criterion::condition, trace = Criterion::a_optimal;
  const BrdfBasis full_stacked = test::data_basis(*folder, stacked, 79);
  const BrdfBasis full_columns = test::data_basis(*folder, columns, 100);
  for (const Case& c : {Case{"sphere", stacked, 45, true, true, kappa, 60, 5},
                        Case{"sphere", columns, 20, false, true, kappa, 40, 3},
                        Case{"bunny", stacked, 45, true, false, kappa, 80, 5},
                        Case{"bunny", columns, 45, false, true, kappa, 40, 3},
                        Case{"bunny", columns, 100, true, true, trace, 60, 4},
                        Case{"happy_buddha", stacked, 20, true, false, kappa, 80, 5},
                        Case{"happy_buddha", stacked, 45, false, false, trace, 40, 3},
                        Case{"dragon", stacked, 79, true, true, kappa, 40, 4},
                        Case{"dragon", columns, 20, true, false, kappa, 60, 5},
                        Case{"teapot", stacked, 45, true, false, kappa, 80, 5},
                        Case{"teapot", columns, 79, false, false, kappa, 40, 4},
                        Case{"head_igea", columns, 45, true, true, kappa, 60, 5},
                        Case{"head_igea", columns, 100, false, false, trace, 30, 3}}) {
    const BrdfBasis basis = truncated(c.layout == stacked ? full_stacked : full_columns, c.k);
    const SceneBins binned =
        bins_of_scene(c.mesh, *folder, basis, c.distant, c.pixels, c.candidates);
    EXPECT_TRUE(equal(binned)) << c.mesh << " distant " << c.distant;
    const CandidateBins& bins = binned.fast;
    SelectionOptions options;
    options.criterion = c.criterion;
    options.stop = StopRule::count;
    options.max_lights = c.lights;
    options.threads = 2;
    LightPlanner planner(basis, bins, options);
    const Selection fast = planner.select(options);
    SelectionOptions brute = options;
    brute.brute_force = true;
    const Selection plain = select_lights(basis, binned.plain, brute);
    EXPECT_TRUE(same(fast, plain)) << c.mesh << " K " << c.k << " distant " << c.distant;
    EXPECT_EQ(fast.lights.size(), static_cast<std::size_t>(c.lights));
    // A light is lost: from what the plan made ready, from nothing, and plainly.
    test::lose_third_light(fast, static_cast<std::size_t>(c.candidates), options);
    const Selection again = planner.select(options);
    EXPECT_TRUE(same(again, select_lights(basis, bins, options))) << c.mesh << " K " << c.k;
    options.brute_force = true;
    EXPECT_TRUE(same(again, select_lights(basis, binned.plain, options))) << c.mesh;
  }
}

/// All 144 combinations, some minutes: tests/planner_exact_all.
TEST(SelectLights, EqualsBruteForceOnEveryCombinationWhenAsked) {
  const auto folder = test::data_folder();
  if (std::getenv("LIGHTRIG_EXACT_ALL") == nullptr) GTEST_SKIP() << "LIGHTRIG_EXACT_ALL not set";
  if (!folder) GTEST_SKIP() << "no data folder (LIGHTRIG_DATA, ../shared/data)";
  for (const ChannelLayout layout : {ChannelLayout::stacked, ChannelLayout::columns}) {
    const BrdfBasis full = test::data_basis(*folder, layout, 79);
    for (const char* mesh : {"sphere", "bunny", "happy_buddha", "dragon", "teapot", "head_igea"}) {
      for (const bool pixels : {false, true}) {
        for (const bool distant : {true, false}) {
          const SceneBins bins = bins_of_scene(mesh, *folder, full, distant, pixels, 40);
          EXPECT_TRUE(equal(bins)) << mesh << " distant " << distant << " pixels " << pixels;
          for (const Eigen::Index k : {20, 45, 79}) {
            const BrdfBasis basis = truncated(full, k);
            SelectionOptions options;
            options.stop = StopRule::count;
            options.max_lights = 4;
            const Selection fast = select_lights(basis, bins.fast, options);
            options.brute_force = true;
            const auto verdict = same(fast, select_lights(basis, bins.plain, options));
            EXPECT_TRUE(verdict);
            std::printf("%-13s %-8s %-7s %-8s K %2d  %zu lights  kappa2 %.10g  %s\n", mesh,
                        layout == ChannelLayout::stacked ? "stacked" : "columns",
                        distant ? "distant" : "near", pixels ? "pixels" : "vertices",
                        static_cast<int>(k), fast.lights.size(), fast.lights.back().score,
                        verdict && equal(bins) ? "equal" : "DIFFERS");
          }
        }
      }
    }
  }
}

TEST(SelectLights, ReplanningWithOneLightLostKeepsTheOthers) {
  const BivariateGrid grid{20, 8};
  const BrdfBasis basis = test::random_basis(3, grid, ChannelLayout::columns, 1, 10, 0.8);
  const CandidateBins bins = test::random_bins(4, grid, 80, true);
  SelectionOptions options;
  options.stop = StopRule::count;
  options.max_lights = 5;
  const Selection whole = select_lights(basis, bins, options);
  ASSERT_EQ(whole.lights.size(), 5U);
  options.excluded.assign(80, 0);
  options.excluded[static_cast<std::size_t>(whole.lights[2].candidate)] = 1;
  for (const int kept : {0, 1, 3, 4}) {
    options.already.push_back(whole.lights[static_cast<std::size_t>(kept)].candidate);
  }
  options.max_lights = 1;
  const Selection again = select_lights(basis, bins, options);
  ASSERT_EQ(again.lights.size(), 1U);
  EXPECT_NE(again.lights[0].candidate, whole.lights[2].candidate);
  std::vector<int> all = options.already;
  all.push_back(again.lights[0].candidate);
  EXPECT_NEAR(conditioning(basis, bins, all).pseudo_condition / again.lights[0].score, 1, 1e-9);
}

TEST(LightPlanner, ChoosesAgainAndAgainWhatSelectLightsChooses) {
  for (std::uint64_t seed = 0; seed < 60; ++seed) {
    SmallProblem problem = small_problem(seed);
    LightPlanner planner(problem.basis, problem.bins, problem.options);
    const Selection first = planner.select(problem.options);
    EXPECT_TRUE(same(first, select_lights(problem.basis, problem.bins, problem.options)));
    if (first.lights.size() < 3) continue;
    // The second light is lost: the others stand, and it may not be taken again.
    SelectionOptions again = problem.options;
    again.excluded.assign(static_cast<std::size_t>(problem.bins.candidates()), 0);
    again.excluded[static_cast<std::size_t>(first.lights[1].candidate)] = 1;
    for (const std::size_t kept : {std::size_t{0}, std::size_t{2}})
      again.already.push_back(first.lights[kept].candidate);
    again.max_lights = 2;
    EXPECT_TRUE(same(planner.select(again), select_lights(problem.basis, problem.bins, again)))
        << "seed " << seed;
    again.brute_force = true;
    EXPECT_TRUE(same(select_lights(problem.basis, problem.bins, again), planner.select(again)))
        << "seed " << seed;
    EXPECT_TRUE(same(planner.select(problem.options), first)) << "seed " << seed;
  }
}

TEST(SelectLights, GoesOnFromRowsOfAnyWorthAsBruteForceDoes) {
  for (std::uint64_t seed = 0; seed < 300; ++seed) {
    SmallProblem problem = small_problem(seed);
    const Eigen::MatrixXd& V = problem.basis.V;
    Eigen::MatrixXd had(1 + static_cast<Eigen::Index>(seed % 9), V.cols());
    for (Eigen::Index r = 0; r < had.rows(); ++r) {
      const auto n = static_cast<Eigen::Index>(seed) + 7 * r;
      had.row(r) = std::sqrt(0.1 + 0.09 * static_cast<double>(n % 10)) * V.row(n % V.rows());
    }
    problem.options.had = had;
    LightPlanner planner(problem.basis, problem.bins, problem.options);
    const Selection fast = planner.select(problem.options);
    SelectionOptions nothing = problem.options, brute = problem.options;
    nothing.had.resize(0, 0);
    brute.brute_force = true;
    ASSERT_TRUE(same(fast, select_lights(problem.basis, problem.bins, brute))) << "seed " << seed;
    // What one plan stood on is forgotten by the next.
    ASSERT_TRUE(same(planner.select(nothing), select_lights(problem.basis, problem.bins, nothing)))
        << "seed " << seed;
  }
}

TEST(LightPlanner, CountsRowsHadAsItCountsTheLightThatShowedThem) {
  for (std::uint64_t seed = 0; seed < 60; ++seed) {
    SmallProblem problem = small_problem(seed);
    int shown = 0;
    while (problem.bins.of(shown).size() < 2) ++shown;
    problem.options.already = {shown};
    const SelectedLight by_light =
        LightPlanner(problem.basis, problem.bins, problem.options).judge(problem.options);
    const Selection after = select_lights(problem.basis, problem.bins, problem.options);
    // The same rows without the light: given as rows, and its cells taken out of the others.
    const auto cells = problem.bins.of(shown);
    const CellRows rows(problem.basis);
    problem.options.had = rows.gather(cells);
    problem.options.already.clear();
    if (problem.options.excluded.empty()) {
      problem.options.excluded.assign(static_cast<std::size_t>(problem.bins.candidates()), 0);
    }
    problem.options.excluded[static_cast<std::size_t>(shown)] = 1;
    CandidateBins left{problem.bins.grid, {0}, {}};
    for (int i = 0; i < problem.bins.candidates(); ++i) {
      for (const std::int32_t cell : problem.bins.of(i)) {
        if (!std::ranges::binary_search(cells, cell)) left.cell.push_back(cell);
      }
      left.offset.push_back(static_cast<std::int64_t>(left.cell.size()));
    }
    LightPlanner planner(problem.basis, left, problem.options);
    const SelectedLight by_rows = planner.judge(problem.options);
    EXPECT_EQ(by_rows.rank, by_light.rank) << "seed " << seed;
    EXPECT_NEAR(by_rows.score / by_light.score, 1, 1e-9) << "seed " << seed;
    EXPECT_NEAR(by_rows.predicted_error_percent / by_light.predicted_error_percent, 1, 1e-9);
    EXPECT_TRUE(same(planner.select(problem.options), after)) << "seed " << seed;
  }
}

TEST(SelectLights, PredictsTheErrorThatTheFitWouldPredict) {
  for (const ChannelLayout layout : {ChannelLayout::columns, ChannelLayout::stacked}) {
    const BivariateGrid grid{15, 6};
    BrdfBasis basis = test::random_basis(9, grid, layout, 3, 8, 0.7);
    basis.model_sigma = 0.2;
    basis.y_min = Eigen::VectorXd::Constant(basis.rows(), -100);
    basis.y_max = Eigen::VectorXd::Constant(basis.rows(), 100);
    basis.mapping.floor = 1e-30;
    const CandidateBins bins = test::random_bins(10, grid, 30, false);
    SelectionOptions options;
    options.max_lights = 1;
    options.stop = StopRule::count;
    options.sigma = 0.3;
    const Selection selection = select_lights(basis, bins, options);
    ASSERT_EQ(selection.lights.size(), 1U);
    // The posterior by its textbook formula: (diag(1/s²) + GᵀG/σ²)⁻¹.
    const auto cells = bins.of(selection.lights[0].candidate);
    Eigen::MatrixXd information = basis.stddev.cwiseAbs2().cwiseInverse().asDiagonal();
    for (const std::int32_t cell : cells) {
      for (int c = 0; c < (layout == ChannelLayout::stacked ? 3 : 1); ++c) {
        const Eigen::RowVectorXd g = basis.V.row(basis.row(cell, c));
        information += g.transpose() * g / (0.3 * 0.3);
      }
    }
    const Eigen::Index columns = layout == ChannelLayout::stacked ? 1 : 3;
    const std::vector<Eigen::MatrixXd> covariance(static_cast<std::size_t>(columns),
                                                  information.inverse());
    const double expected =
        predicted_error_percent(basis, covariance, Eigen::MatrixXd::Zero(8, columns));
    EXPECT_NEAR(selection.lights[0].predicted_error_percent, expected, 1e-9 * expected);
  }
}

TEST(PlannerKernels, AgreeOnEveryProcessorLevel) {
  const BivariateGrid grid{30, 10};
  const BrdfBasis basis = test::random_basis(5, grid, ChannelLayout::columns, 1, 21, 0.9);
  PackedRows rows;
  rows.k = 21;
  rows.stride = 24;
  rows.data.assign(300 * 24, 0.0);
  for (int r = 0; r < 300; ++r) {
    for (int j = 0; j < 21; ++j) rows.data[static_cast<std::size_t>(r * 24 + j)] = basis.V(r, j);
  }
  std::vector<std::int32_t> cells;
  for (int c = 0; c < 300; c += 7) cells.push_back(c);
  std::vector<std::vector<double>> gram, energy;
  const std::vector<double> x(rows.data.begin() + 48, rows.data.begin() + 72);
  const std::vector<double> y(rows.data.begin() + 96, rows.data.begin() + 120);
  std::vector<double> energy_of_y(cells.size());
  for (int level = 2; level <= vector_level(); ++level) {
    gram.emplace_back(21 * 24, 0.0);
    add_gram(rows, cells, gram.back(), level);
    energy.emplace_back(cells.size());
    cell_energies(rows, cells, x, y, energy.back(), energy_of_y, level);
    for (std::size_t j = 0; j < cells.size(); ++j) {
      double along = 0;
      for (int i = 0; i < 24; ++i) along += rows.of(cells[j])[i] * y[static_cast<std::size_t>(i)];
      ASSERT_NEAR(energy_of_y[j], along * along, 1e-15);
    }
  }
  for (std::size_t i = 1; i < gram.size(); ++i) {
    for (std::size_t j = 0; j < gram[i].size(); ++j) ASSERT_NEAR(gram[i][j], gram[0][j], 1e-15);
    for (std::size_t j = 0; j < energy[i].size(); ++j) {
      ASSERT_NEAR(energy[i][j], energy[0][j], 1e-15);
    }
  }
  Eigen::MatrixXd G = Eigen::MatrixXd::Zero(21, 21);
  for (const std::int32_t c : cells) G += basis.V.row(c).transpose() * basis.V.row(c);
  for (int i = 0; i < 21; ++i) {
    for (int j = i; j < 21; ++j) {
      ASSERT_NEAR(gram[0][static_cast<std::size_t>(i * 24 + j)], G(i, j), 1e-14);
    }
  }
}

}  // namespace
}  // namespace lightrig
