// The whole plan against the paper's loop in numpy and the best numpy, side by side, and against
// what this machine's memory and arithmetic allow.

#include <fmt/format.h>
#include <sys/resource.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <filesystem>
#include <fstream>
#include <functional>
#include <sstream>
#include <string>

#include "bench/planner_floor.h"
#include "core/planner.h"
#include "core/surface_points.h"
#include "tests/core/planner_scene.h"
#include "tests/paths.h"

namespace {

using namespace lightrig;

double seconds_of(clockid_t clock) {
  timespec t{};
  clock_gettime(clock, &t);
  return static_cast<double>(t.tv_sec) + 1e-9 * static_cast<double>(t.tv_nsec);
}

struct Problem {
  BrdfBasis basis;
  Mesh mesh;
  CameraModel camera;
  std::vector<LightPosition> lights;
  int count = 7;
};

struct PlanTimes {
  double points = 0, bins = 0, select = 0;  ///< [s]
  Selection selection;
  BinningResult binning;
  double total() const { return points + bins + select; }
};

/// From mesh and basis in memory to the plan, on a clock of choice.
PlanTimes plan(const Problem& problem, const Occluder& occluder, ShadowRays rays, int threads,
               clockid_t clock) {
  PlanTimes times;
  const double start = seconds_of(clock);
  const SurfacePoints points = facing_vertices(problem.mesh, problem.camera);
  const double seen = seconds_of(clock);
  times.binning = bin_candidates(points, problem.lights, problem.basis.grid, problem.basis.valid,
                                 no_grazing_limits, occluder, rays, threads);
  const double binned = seconds_of(clock);
  SelectionOptions options;
  options.stop = StopRule::count;
  options.max_lights = problem.count;
  options.threads = threads;
  times.selection = select_lights(problem.basis, times.binning.bins, options);
  times.points = seen - start;
  times.bins = binned - seen;
  times.select = seconds_of(clock) - binned;
  return times;
}

void take_faster(PlanTimes& best, PlanTimes next) {
  if (best.selection.lights.empty() || next.total() < best.total()) best = std::move(next);
}

PlanTimes best_plan(const Problem& problem, const Occluder& occluder, ShadowRays rays, int threads,
                    clockid_t clock, int repeats) {
  PlanTimes best;
  for (int i = 0; i < repeats; ++i) {
    take_faster(best, plan(problem, occluder, rays, threads, clock));
  }
  return best;
}

/// Planning again when the third light is lost and the others stand, from what a plan made ready.
double replan_seconds(const Problem& problem, const CandidateBins& bins, int repeats) {
  SelectionOptions options;
  options.stop = StopRule::count;
  options.max_lights = problem.count;
  LightPlanner planner(problem.basis, bins, options);
  const Selection whole = planner.select(options);
  test::lose_third_light(whole, problem.lights.size(), options);
  double best = std::numeric_limits<double>::infinity();
  for (int i = 0; i < repeats; ++i) {
    const double start = seconds_of(CLOCK_PROCESS_CPUTIME_ID);
    planner.select(options);
    best = std::min(best, seconds_of(CLOCK_PROCESS_CPUTIME_ID) - start);
  }
  return best;
}

/// The problem as raw arrays for the numpy programs.
void write_problem(const Problem& problem, const std::filesystem::path& folder) {
  std::ofstream sizes(folder / "sizes.txt");
  const auto put = [&](const std::string& name, const std::string& kind, const void* data,
                       std::size_t bytes, const std::string& shape) {
    std::ofstream(folder / (name + ".bin"), std::ios::binary)
        .write(static_cast<const char*>(data), static_cast<std::streamsize>(bytes));
    sizes << name << ' ' << kind << ' ' << shape << '\n';
  };
  const Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor> V = problem.basis.V;
  put("V", "float64", V.data(), sizeof(double) * static_cast<std::size_t>(V.size()),
      fmt::format("{} {}", V.rows(), V.cols()));
  const std::vector<std::int32_t> valid(problem.basis.valid.begin(), problem.basis.valid.end());
  put("valid", "int32", valid.data(), 4 * valid.size(), std::to_string(valid.size()));
  const std::int32_t grid[2] = {problem.basis.grid.n_h, problem.basis.grid.n_d};
  put("grid", "int32", grid, sizeof grid, "2");
  put("count", "int32", &problem.count, 4, "1");
  const Eigen::Vector3d view = view_direction(problem.camera, Eigen::Vector3d::Zero());
  put("view", "float64", view.data(), 24, "3");
  std::vector<double> lights;
  for (const LightPosition& light : problem.lights) {
    lights.insert(lights.end(), light.p.begin(), light.p.end());
  }
  put("lights", "float64", lights.data(), 8 * lights.size(),
      fmt::format("{} 3", problem.lights.size()));
  put("normals", "float64", problem.mesh.normals.data(),
      8 * static_cast<std::size_t>(problem.mesh.normals.size()),
      fmt::format("{} 3", problem.mesh.normals.cols()));
}

struct Baseline {
  std::vector<int> lights;
  std::vector<double> condition;              ///< κ² after each light
  double bins = 0, selection = 0, total = 0;  ///< [s]
  std::string blas;
};

/// The text behind `"key": ` up to one of `ends`.
std::string after(const std::string& json, const std::string& key, const char* ends) {
  const std::size_t at = json.find("\"" + key + "\": ");
  if (at == std::string::npos) return "";
  const std::size_t from = at + key.size() + 4;
  return json.substr(from, json.find_first_of(ends, from) - from);
}

Baseline run_baseline(const std::string& script, const std::filesystem::path& folder, int repeats) {
  const std::string command =
      fmt::format("OPENBLAS_NUM_THREADS=1 /usr/bin/python3 {}/bench/baselines/{} {} {}",
                  lightrig::test::source_dir, script, folder.string(), repeats);
  std::FILE* pipe = popen(command.c_str(), "r");
  std::string json;
  for (int c = pipe != nullptr ? std::fgetc(pipe) : EOF; c != EOF; c = std::fgetc(pipe)) {
    json.push_back(static_cast<char>(c));
  }
  if (pipe == nullptr || pclose(pipe) != 0) {
    fmt::print(stderr, "running the baseline failed: {}; it needs python3-numpy and libopenblas\n",
               command);
    std::exit(1);
  }
  Baseline baseline;
  std::istringstream lights(after(json, "lights", "]").substr(1));
  for (std::string word; std::getline(lights, word, ',');) {
    baseline.lights.push_back(std::stoi(word));
  }
  std::istringstream condition(after(json, "condition", "]").substr(1));
  for (std::string word; std::getline(condition, word, ',');) {
    baseline.condition.push_back(std::strtod(word.c_str(), nullptr));  // "Infinity" where it is so
  }
  baseline.bins = std::stod(after(json, "bins", ",}"));
  baseline.selection = std::stod(after(json, "selection", ",}"));
  baseline.total = std::stod(after(json, "total", ",}"));
  baseline.blas = after(json, "blas", "}");
  return baseline;
}

/// Pairs of a candidate and a point that faces both the camera and it.
double lit_pairs(const SurfacePoints& points, const std::vector<LightPosition>& lights) {
  Eigen::Index pairs = 0;
  for (const LightPosition& light : lights) {
    pairs += ((points.normal.transpose() * light.p).array() > 0).count();
  }
  return static_cast<double>(pairs);
}

std::vector<int> lights_of(const PlanTimes& times) {
  std::vector<int> lights;
  for (const SelectedLight& light : times.selection.lights) lights.push_back(light.candidate);
  return lights;
}

/// [MiB] the most that this process has held.
double peak_mib() {
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  return static_cast<double>(usage.ru_maxrss) / 1024;
}

void print_scaling(const Problem& whole, const BrdfBasis& wide, const Occluder& occluder) {
  fmt::print(
      "\nscaling (CPU s, one thread; wall s where two; peak MiB of the process so far)\n{:>8} "
      "{:>7} {:>4} {:>8} {:>9} {:>9} {:>9} {:>9}\n",
      "M", "N", "K", "threads", "bins", "select", "total", "peak");
  const auto row = [&](const Problem& problem, int threads, int repeats = 3) {
    const PlanTimes t =
        best_plan(problem, occluder, ShadowRays::none, threads,
                  threads > 1 ? CLOCK_MONOTONIC : CLOCK_PROCESS_CPUTIME_ID, repeats);
    fmt::print("{:>8} {:>7} {:>4} {:>8} {:>9.4f} {:>9.4f} {:>9.4f} {:>9.0f}\n",
               problem.lights.size(), problem.mesh.vertices.cols(), problem.basis.components(),
               threads, t.bins, t.select, t.total(), peak_mib());
  };
  for (const Eigen::Index step : {4, 2}) {
    Problem problem = whole;
    const Eigen::Index n = whole.mesh.vertices.cols() / step;
    for (Eigen::Index i = 0; i < n; ++i) {
      problem.mesh.vertices.col(i) = whole.mesh.vertices.col(i * step);
      problem.mesh.normals.col(i) = whole.mesh.normals.col(i * step);
    }
    problem.mesh.vertices.conservativeResize(3, n);
    problem.mesh.normals.conservativeResize(3, n);
    row(problem, 1);
  }
  for (const Eigen::Index k : {20, 30, 79}) {
    Problem problem = whole;
    problem.basis = k > whole.basis.components() ? wide : truncated(whole.basis, k);
    row(problem, 1);
    if (k == 79) row(problem, 2);
  }
  // The largest last: a process's peak only grows.
  for (const int M : {250, 1000, 4000, 16000, 100000}) {
    Problem problem = whole;
    problem.lights = test::spread_lights(M, true, 0);
    row(problem, 1, M > 16000 ? 1 : 3);
    if (M == 1000 || M > 16000) row(problem, 2, M > 16000 ? 1 : 3);
  }
}

/// How far the κ² after each light lie apart, relative.
double condition_differs(const PlanTimes& ours, const std::vector<double>& theirs) {
  if (ours.selection.lights.size() != theirs.size()) return 1;
  double most = 0;
  for (std::size_t i = 0; i < theirs.size(); ++i) {
    const double mine = ours.selection.lights[i].condition;
    if (mine != theirs[i]) most = std::max(most, std::abs(mine / theirs[i] - 1));
  }
  return most;
}

}  // namespace

int main(int argc, char** argv) {
  const auto data = test::data_folder();
  if (!data) {
    fmt::print(stderr, "compare_planner needs the data folder (LIGHTRIG_DATA, ../shared/data)\n");
    return 1;
  }
  const int repeats = argc > 1 ? std::max(1, std::atoi(argv[1])) : 5;
  Problem problem;
  const BrdfBasis wide = test::data_basis(*data, ChannelLayout::stacked, 79);
  problem.basis = test::data_basis(*data, ChannelLayout::stacked, 45);
  problem.mesh = test::data_mesh(*data, "bunny");
  problem.camera = test::facing_camera(true, 4, 2000, 2000);
  problem.lights = test::spread_lights(1000, true, 0);
  const auto folder =
      std::filesystem::temp_directory_path() / fmt::format("lightrig-plan-{}", getpid());
  std::filesystem::create_directories(folder);
  write_problem(problem, folder);

  fmt::print(
      "bunny, {} vertices, {} candidates, K = {}, {} lights; from mesh and basis in memory to the "
      "plan;\n"
      "CPU seconds of one thread, best of {} runs of each, all in this run\n",
      problem.mesh.vertices.cols(), problem.lights.size(), problem.basis.components(),
      problem.count, repeats);
  const double before = seconds_of(CLOCK_PROCESS_CPUTIME_ID);
  const Occluder occluder(problem.mesh);
  const double tree = seconds_of(CLOCK_PROCESS_CPUTIME_ID) - before;
  const Baseline naive = run_baseline("plan_naive.py", folder, repeats);
  const Baseline best = run_baseline("plan_best.py", folder, repeats);
  // Turn by turn, so that whatever else the machine does meets all of them.
  PlanTimes fastest, shadows, two;
  for (int i = 0; i < repeats; ++i) {
    take_faster(fastest, plan(problem, occluder, ShadowRays::none, 1, CLOCK_PROCESS_CPUTIME_ID));
    take_faster(shadows, plan(problem, occluder, ShadowRays::needed, 1, CLOCK_PROCESS_CPUTIME_ID));
    take_faster(two, plan(problem, occluder, ShadowRays::none, 2, CLOCK_MONOTONIC));
  }
  std::filesystem::remove_all(folder);

  fmt::print("BLAS of the baselines: {}, one thread\n\n", best.blas);
  fmt::print("{:<34} {:>9} {:>9} {:>9} {:>9}  lights\n", "", "points", "bins", "select", "total");
  const auto line = [](const char* name, double points, double bins, double select, double total,
                       const std::vector<int>& lights) {
    fmt::print("{:<34} {:>9.4f} {:>9.4f} {:>9.4f} {:>9.4f}  {}\n", name, points, bins, select,
               total, fmt::format("{}", fmt::join(lights, " ")));
  };
  line("(a) the paper's loop, numpy", 0, naive.bins, naive.selection, naive.total, naive.lights);
  line("(b) best numpy", 0, best.bins, best.selection, best.total, best.lights);
  line("lightrig", fastest.points, fastest.bins, fastest.select, fastest.total(),
       lights_of(fastest));
  line("lightrig, shadows", shadows.points, shadows.bins, shadows.select, shadows.total(),
       lights_of(shadows));
  line("lightrig, two threads (wall)", two.points, two.bins, two.select, two.total(),
       lights_of(two));
  const double rays = static_cast<double>(shadows.binning.statistics.rays_cast) /
                      static_cast<double>(shadows.binning.bins.cell.size());
  fmt::print(
      "\nshadows: {} rays, {:.2f} per filled bin, {:.2f} times the plan without; tree of the mesh "
      "{:.4f} s, "
      "built once per object\n",
      shadows.binning.statistics.rays_cast, rays, shadows.total() / fastest.total(), tree);
  fmt::print("exact evaluations {} of {} bounded away {}, merged {}\n",
             fastest.selection.statistics.exact_evaluations,
             problem.lights.size() * static_cast<std::size_t>(problem.count),
             fastest.selection.statistics.bounded_away,
             fastest.selection.statistics.identical_candidates);
  // A thousandth of a second each: ten times as many find one that nothing else got in the way of.
  const double replan = replan_seconds(problem, fastest.binning.bins, 10 * repeats);
  fmt::print("planning again with one of {} lights lost: {:.4f} s, {:.3f} of a plan\n",
             problem.count, replan, replan / fastest.total());
  bench::Machine machine;
  for (int i = 0; i < repeats; ++i) machine.measure();
  const SurfacePoints facing = facing_vertices(problem.mesh, problem.camera);
  const bench::Floors floors = bench::print_floors(
      problem.basis, fastest.binning.bins, fastest.selection, static_cast<double>(facing.size()),
      lit_pairs(facing, problem.lights), machine);
  fmt::print("this plan is {:.2f} times A, {:.1f} times B\n", fastest.total() / floors.greedy,
             fastest.total() / floors.oracle);
  const double apart = std::max(condition_differs(fastest, naive.condition),
                                condition_differs(fastest, best.condition));
  fmt::print("condition numbers differ from numpy's by at most {:.1e}\n", apart);
  print_scaling(problem, wide, occluder);
  fmt::print("peak memory {:.0f} MiB (with the problem and its copies)\n\n", peak_mib());
  const bool same = lights_of(fastest) == naive.lights && naive.lights == best.lights &&
                    lights_of(two) == best.lights && apart <= 1e-9;
  fmt::print(
      "speedup_naive={:.1f} speedup_best_numpy={:.1f} speedup_naive_two_threads={:.1f} "
      "speedup_best_numpy_two_threads={:.1f} over_floor={:.2f} over_oracle={:.1f} same_lights={} "
      "condition_apart={:.1e} rays_per_bin={:.2f} shadows_times={:.2f} replan_share={:.3f}\n",
      naive.total / fastest.total(), best.total / fastest.total(), naive.total / two.total(),
      best.total / two.total(), fastest.total() / floors.greedy, fastest.total() / floors.oracle,
      same, apart, rays, shadows.total() / fastest.total(), replan / fastest.total());
  return same ? 0 : 1;
}
