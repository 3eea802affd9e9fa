// The whole plan against the paper's loop in numpy and the best numpy, side by side, and against
// the floor that this machine's memory and arithmetic set.

#include <fmt/format.h>
#include <sys/resource.h>
#include <unistd.h>

#include <Eigen/QR>
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

#include "core/planner.h"
#include "core/planner_kernels.h"
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

PlanTimes best_plan(const Problem& problem, const Occluder& occluder, ShadowRays rays, int threads,
                    clockid_t clock, int repeats) {
  PlanTimes best = plan(problem, occluder, rays, threads, clock);
  for (int i = 1; i < repeats; ++i) {
    PlanTimes next = plan(problem, occluder, rays, threads, clock);
    if (next.total() < best.total()) best = std::move(next);
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

struct Machine {
  double bandwidth = 0;  ///< [B/s] reading memory, one thread
  double flops = 0;      ///< [1/s] of a product of matrices that fit the cache, one thread
};

Machine measured_machine() {
  Machine machine;
  const std::vector<double> memory(std::size_t{1} << 24, 1.0);  // 128 MiB
  double sink = 0;
  for (int i = 0; i < 4; ++i) {
    const double start = seconds_of(CLOCK_PROCESS_CPUTIME_ID);
    sink += Eigen::Map<const Eigen::VectorXd>(memory.data(), Eigen::Index{1} << 24).sum();
    const double taken = seconds_of(CLOCK_PROCESS_CPUTIME_ID) - start;
    machine.bandwidth = std::max(machine.bandwidth, static_cast<double>(8 * memory.size()) / taken);
  }
  PackedRows rows;
  rows.k = rows.stride = 48;
  rows.data.assign(240 * 48, 0.01);
  std::vector<std::int32_t> cells;
  for (int c = 0; c < 240; ++c) cells.push_back(c);
  std::vector<double> A(48 * 48, 0.0);
  for (int i = 0; i < 50; ++i) {
    const double start = seconds_of(CLOCK_PROCESS_CPUTIME_ID);
    for (int k = 0; k < 20; ++k) add_gram(rows, cells, A, vector_level());
    const double taken = seconds_of(CLOCK_PROCESS_CPUTIME_ID) - start;
    // Vectors of eight columns from the diagonal's on: 6 + 6 + … rows of 48, 40, … 8 columns.
    const double products = 20.0 * 240 * 8 * (48 + 40 + 32 + 24 + 16 + 8);
    machine.flops = std::max(machine.flops, 2 * products / taken);
  }
  if (sink == 0) std::puts("");  // the sums are needed
  return machine;
}

/// What no exact method can do without, with nothing added for how this one works. Memory: every
/// point that faces the camera, its normal alone, and every distinct row of V twice, once to bound
/// or add what it is and once to decide; the cells of every candidate once. Arithmetic: a product
/// n·h for every such point under one light (others may be told by it), and, for every light
/// chosen, the rows that it adds taken up in a factor of K columns and one spectrum of it. Both at
/// the rates measured, at once: a processor computes while it reads.
double floor_seconds(const Problem& problem, const PlanTimes& ours, const Machine& machine) {
  const double K = static_cast<double>(problem.basis.components());
  const double per_cell =
      problem.basis.layout == ChannelLayout::stacked ? problem.basis.channels : 1;
  std::vector<std::int32_t> used = ours.binning.bins.cell;
  std::sort(used.begin(), used.end());
  used.erase(std::unique(used.begin(), used.end()), used.end());
  const double rows = per_cell * static_cast<double>(used.size());
  const double filled = static_cast<double>(ours.binning.bins.cell.size());
  const double points = static_cast<double>(facing_vertices(problem.mesh, problem.camera).size());
  double added = 0;
  for (const SelectedLight& light : ours.selection.lights) added += per_cell * light.new_cells;
  const double bytes = 8 * 3 * points + 2 * 8 * rows * K + 4 * filled;
  const double spectra = problem.count * 4.0 / 3 * K * K * K;
  const double operations = 5 * points + 2 * added * K * K + spectra;
  const double reading = bytes / machine.bandwidth, computing = operations / machine.flops;
  fmt::print(
      "floor = max(bytes / bandwidth, operations / rate), of what any exact method must do:\n"
      "  bytes = 8·3·points + 2·8·rows·K + 4·filled = {:.1f} MB at {:.1f} GB/s: {:.5f} s\n"
      "  operations = 5·points + 2·added·K² + lights·4/3·K³ = {:.1f} M at {:.1f} G/s: {:.5f} s\n"
      "  points {} (facing the camera) rows {} (distinct) filled {} added {} (rows of the lights "
      "chosen)\n",
      bytes / 1e6, machine.bandwidth / 1e9, reading, operations / 1e6, machine.flops / 1e9,
      computing, points, rows, filled, added);
  return std::max(reading, computing);
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
      "CPU seconds of one thread, best of several runs, all in this run\n",
      problem.mesh.vertices.cols(), problem.lights.size(), problem.basis.components(),
      problem.count);
  const double before = seconds_of(CLOCK_PROCESS_CPUTIME_ID);
  const Occluder occluder(problem.mesh);
  const double tree = seconds_of(CLOCK_PROCESS_CPUTIME_ID) - before;
  const PlanTimes ours =
      best_plan(problem, occluder, ShadowRays::none, 1, CLOCK_PROCESS_CPUTIME_ID, repeats);
  const Baseline naive = run_baseline("plan_naive.py", folder, 1);
  const Baseline best = run_baseline("plan_best.py", folder, 2);
  const PlanTimes again =
      best_plan(problem, occluder, ShadowRays::none, 1, CLOCK_PROCESS_CPUTIME_ID, repeats);
  const PlanTimes& fastest = again.total() < ours.total() ? again : ours;
  const PlanTimes shadows =
      best_plan(problem, occluder, ShadowRays::needed, 1, CLOCK_PROCESS_CPUTIME_ID, repeats);
  const PlanTimes two = best_plan(problem, occluder, ShadowRays::none, 2, CLOCK_MONOTONIC, repeats);
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
  const double replan = replan_seconds(problem, fastest.binning.bins, 3 * repeats);
  fmt::print("planning again with one of {} lights lost: {:.4f} s, {:.3f} of a plan\n",
             problem.count, replan, replan / fastest.total());
  const double floor = floor_seconds(problem, fastest, measured_machine());
  fmt::print("floor {:.5f} s\n", floor);
  const double apart = std::max(condition_differs(fastest, naive.condition),
                                condition_differs(fastest, best.condition));
  fmt::print("condition numbers differ from numpy's by at most {:.1e}\n", apart);
  print_scaling(problem, wide, occluder);
  fmt::print("peak memory {:.0f} MiB (with the problem and its copies)\n\n", peak_mib());
  const bool same = lights_of(fastest) == naive.lights && naive.lights == best.lights &&
                    lights_of(two) == best.lights && apart <= 1e-9;
  fmt::print(
      "speedup_naive={:.1f} speedup_best_numpy={:.1f} speedup_naive_two_threads={:.1f} "
      "speedup_best_numpy_two_threads={:.1f} over_floor={:.2f} same_lights={} "
      "condition_apart={:.1e} rays_per_bin={:.2f} shadows_times={:.2f} replan_share={:.3f}\n",
      naive.total / fastest.total(), best.total / fastest.total(), naive.total / two.total(),
      best.total / two.total(), fastest.total() / floor, same, apart, rays,
      shadows.total() / fastest.total(), replan / fastest.total());
  return same ? 0 : 1;
}
