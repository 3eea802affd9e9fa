// Each stage of a plan by itself: Google Benchmark. Filters, repetitions and output as of that
// library: bench/planner_stages --benchmark_filter=select.

#include <benchmark/benchmark.h>

#include "core/planner.h"
#include "core/route.h"
#include "core/surface_points.h"
#include "tests/core/planner_scene.h"

namespace {

using namespace lightrig;

/// A dented ball of 16,386 vertices seen by a camera, and lamps all round: no file is needed.
struct Stage {
  Mesh mesh;
  Occluder occluder;
  BrdfBasis basis;
  CameraModel camera;
  std::vector<LightPosition> lights;
  SurfacePoints points;

  Stage(bool distant, int candidates, Eigen::Index components)
      : mesh(dented(test::sphere_mesh(6))),
        occluder(mesh),
        basis(test::random_basis(1, {}, ChannelLayout::stacked, 3, components, 0.9)),
        camera(test::facing_camera(distant, 4, 400, 400)),
        lights(test::spread_lights(candidates, distant, 3)),
        points(points_of_vertices(mesh, occluder, camera)) {}

  /// Not convex: its valleys are in shadow.
  static Mesh dented(Mesh mesh) {
    for (Eigen::Index i = 0; i < mesh.vertices.cols(); ++i) {
      const Eigen::Vector3d p = mesh.vertices.col(i);
      mesh.vertices.col(i) = p * (1 - 0.15 * std::abs(std::sin(6 * p.x()) * std::cos(5 * p.z())));
    }
    return mesh;
  }
  BinningResult bins(ShadowRays rays, int threads) const {
    return bin_candidates(points, lights, basis.grid, basis.valid, no_grazing_limits, occluder,
                          rays, threads);
  }
};

SelectionOptions seven(Criterion criterion, int threads) {
  SelectionOptions options;
  options.criterion = criterion;
  options.stop = StopRule::count;
  options.max_lights = 7;
  options.threads = threads;
  return options;
}

void build_occluder(benchmark::State& state) {
  const Mesh mesh = test::sphere_mesh(6);
  for (auto _ : state) benchmark::DoNotOptimize(Occluder(mesh).convex());
}
BENCHMARK(build_occluder)->Unit(benchmark::kMillisecond);

void points_of_the_picture(benchmark::State& state) {
  const Stage stage(false, 1, 4);
  for (auto _ : state) {
    benchmark::DoNotOptimize(points_of_pixels(stage.mesh, stage.occluder, stage.camera, 1));
  }
}
BENCHMARK(points_of_the_picture)->Unit(benchmark::kMillisecond);

/// Arguments: distant, candidates, threads.
void bin_without_shadows(benchmark::State& state) {
  const Stage stage(state.range(0) != 0, static_cast<int>(state.range(1)), 4);
  for (auto _ : state) {
    benchmark::DoNotOptimize(stage.bins(ShadowRays::none, static_cast<int>(state.range(2))));
  }
  state.SetItemsProcessed(state.iterations() * state.range(1));
}
BENCHMARK(bin_without_shadows)
    ->ArgsProduct({{1, 0}, {250, 1000}, {1, 2}})
    ->Unit(benchmark::kMillisecond)
    ->UseRealTime();

void bin_with_shadows(benchmark::State& state) {
  const Stage stage(state.range(0) != 0, static_cast<int>(state.range(1)), 4);
  std::int64_t rays = 0;
  for (auto _ : state) {
    const BinningResult result = stage.bins(ShadowRays::needed, static_cast<int>(state.range(2)));
    rays = result.statistics.rays_cast;
  }
  state.counters["rays"] = static_cast<double>(rays);
}
BENCHMARK(bin_with_shadows)
    ->ArgsProduct({{1, 0}, {250}, {1, 2}})
    ->Unit(benchmark::kMillisecond)
    ->UseRealTime();

/// Packing rows and grouping candidates: all that is made ready before the first light.
void make_ready(benchmark::State& state) {
  const Stage stage(true, static_cast<int>(state.range(0)), 45);
  const CandidateBins bins = stage.bins(ShadowRays::none, 2).bins;
  const SelectionOptions options = seven(Criterion::condition, 1);
  for (auto _ : state) {
    const LightPlanner planner(stage.basis, bins, options);
    benchmark::DoNotOptimize(&planner);
  }
}
BENCHMARK(make_ready)->Arg(1000)->Arg(4000)->Unit(benchmark::kMillisecond);

/// Arguments: distant, candidates, components.
void select_by(benchmark::State& state, Criterion criterion) {
  const Stage stage(state.range(0) != 0, static_cast<int>(state.range(1)), state.range(2));
  const CandidateBins bins = stage.bins(ShadowRays::none, 2).bins;
  const SelectionOptions options = seven(criterion, 1);
  std::int64_t exact = 0;
  for (auto _ : state) {
    exact = select_lights(stage.basis, bins, options).statistics.exact_evaluations;
  }
  state.counters["exact"] = static_cast<double>(exact);
}
BENCHMARK_CAPTURE(select_by, condition, Criterion::condition)
    ->ArgsProduct({{1, 0}, {250, 1000}, {20, 45}})
    ->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(select_by, a_optimal, Criterion::a_optimal)
    ->ArgsProduct({{1, 0}, {250, 1000}, {45, 100}})
    ->Unit(benchmark::kMillisecond);

/// One of seven lights is lost: the next choice with the others standing.
void replan(benchmark::State& state, Criterion criterion) {
  const Stage stage(true, 1000, 45);
  const CandidateBins bins = stage.bins(ShadowRays::none, 2).bins;
  SelectionOptions options = seven(criterion, 1);
  LightPlanner planner(stage.basis, bins, options);
  const Selection whole = planner.select(options);
  test::lose_third_light(whole, stage.lights.size(), options);
  for (auto _ : state) benchmark::DoNotOptimize(planner.select(options));
}
BENCHMARK_CAPTURE(replan, condition, Criterion::condition)->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(replan, a_optimal, Criterion::a_optimal)->Unit(benchmark::kMillisecond);

void order_the_route(benchmark::State& state) {
  GantryModel gantry;
  gantry.kinematics = DomeKinematics{Eigen::Vector3d::Zero(), 1.0};
  gantry.axes = {{"azimuth", true, -3, 3, 1, 2, 0}, {"elevation", true, 0, 1.5, 1, 2, 0}};
  std::vector<GantryPosition> stops;
  for (int i = 0; i < state.range(0); ++i) {
    GantryPosition stop;
    stop.axes = Eigen::Vector2d(3 * std::sin(1.7 * i), 0.75 + 0.7 * std::cos(2.3 * i));
    stops.push_back(stop);
  }
  GantryPosition home;
  home.axes = Eigen::Vector2d(0, 0);
  for (auto _ : state) benchmark::DoNotOptimize(order_route(gantry, home, stops));
}
BENCHMARK(order_the_route)->Arg(8)->Arg(12)->Arg(40)->Unit(benchmark::kMicrosecond);

}  // namespace

BENCHMARK_MAIN();
