#include "study/job.h"

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <random>

#include "core/planner.h"
#include "study/estimate.h"

namespace lightrig {
namespace {

/// Seconds since the last call, put down under a stage's name.
class Stopwatch {
 public:
  Stopwatch(std::string object, int split, std::vector<CostRow>& costs)
      : object_(std::move(object)), split_(split), costs_(costs) {}
  void lap(const std::string& stage) {
    const auto now = std::chrono::steady_clock::now();
    costs_.push_back({object_, split_, stage, std::chrono::duration<double>(now - last_).count()});
    last_ = now;
  }

 private:
  std::string object_;
  int split_;
  std::vector<CostRow>& costs_;
  std::chrono::steady_clock::time_point last_ = std::chrono::steady_clock::now();
};

/// Cells of the first n of some lights, sorted, once each.
std::vector<std::int32_t> cells_of(const CandidateBins& bins, const std::vector<int>& lights,
                                   std::size_t n) {
  std::vector<std::int32_t> cells;
  for (std::size_t i = 0; i < std::min(n, lights.size()); ++i) {
    const std::span<const std::int32_t> some = bins.of(lights[i]);
    cells.insert(cells.end(), some.begin(), some.end());
  }
  std::sort(cells.begin(), cells.end());
  cells.erase(std::unique(cells.begin(), cells.end()), cells.end());
  return cells;
}

struct Chosen {
  std::vector<int> lights;
  std::vector<double> condition;  ///< after each light
};

Chosen choose(const BrdfBasis& basis, const CandidateBins& bins, Criterion criterion, int most,
              int threads) {
  SelectionOptions options;
  options.criterion = criterion;
  options.stop = StopRule::count;
  options.max_lights = most;
  options.sigma = basis.model_sigma;
  options.threads = threads;
  Chosen out;
  for (const SelectedLight& light : select_lights(basis, bins, options).lights) {
    out.lights.push_back(light.candidate);
    out.condition.push_back(light.condition);
  }
  return out;
}

/// Candidates that show anything, `most` of them without repetition.
Chosen draw(const CandidateBins& bins, int most, std::uint64_t seed) {
  std::vector<int> useful;
  for (int i = 0; i < bins.candidates(); ++i) {
    if (!bins.of(i).empty()) useful.push_back(i);
  }
  std::mt19937_64 random(seed);
  Chosen out;
  while (static_cast<int>(out.lights.size()) < most && !useful.empty()) {
    const auto at = static_cast<std::ptrdiff_t>(random() % useful.size());
    out.lights.push_back(useful[static_cast<std::size_t>(at)]);
    useful.erase(useful.begin() + at);
  }
  out.condition.assign(out.lights.size(), std::nan(""));
  return out;
}

/// Components that a-optimal planning looks at: the posterior of the rest hardly moves its choice.
constexpr Eigen::Index planning_components = 60;

struct Job {
  const StudyScene& scene;
  const StudySplit& split;
  const StudyOptions& options;
  const std::vector<int>& lights;
  JobResult result;

  void report(const std::string& method, int run, int n, double condition,
              const std::vector<MaterialResult>& materials) {
    for (std::size_t m = 0; m < materials.size(); ++m) {
      const MaterialResult& r = materials[m];
      result.rows.push_back({scene.object, split.index, method, run, n, split.test[m].name,
                             r.error.percent_log, r.error.percent_linear_cos,
                             r.error.median_abs_log, r.predicted, r.low, r.high, condition});
    }
  }

  /// One light set under one estimator, at every reported number of lights.
  void estimate(const std::string& method, const CandidateBins& bins, const Chosen& chosen, int run,
                bool map) {
    if (!wanted(options, method)) return;
    const bool exact = options.noise <= 0 && options.exposures <= 0;
    for (const int n : lights) {
      if (n > static_cast<int>(chosen.lights.size())) continue;
      const std::vector<std::int32_t> cells =
          cells_of(bins, chosen.lights, static_cast<std::size_t>(n));
      const std::uint64_t seed = options.seed + 1009 * static_cast<std::uint64_t>(split.index) +
                                 static_cast<std::uint64_t>(n);
      const double condition = chosen.condition[static_cast<std::size_t>(n - 1)];
      report(method, run, n, condition,
             !exact ? estimate_measured(split, map, cells, options, seed)
             : map  ? estimate_map(split, cells, options.floor)
                    : estimate_paper(split, cells, options.floor));
    }
  }
};

}  // namespace

std::span<const StudyMethod> study_methods() {
  static const std::array<StudyMethod, 7> methods = {
      StudyMethod{"mean", "the mean material, no light at all: the zero line"},
      StudyMethod{"random", "random lights, vertices, pseudo-inverse"},
      StudyMethod{"random-map", "the same random lights, MAP"},
      StudyMethod{"paper", "least condition number over vertices, pseudo-inverse [Ali 2013]"},
      StudyMethod{"paper-map", "the paper's lights, MAP"},
      StudyMethod{"pixels-map", "least condition number over pixels, MAP"},
      StudyMethod{"a-optimal-map", "least expected error over pixels, MAP"}};
  return methods;
}

bool wanted(const StudyOptions& options, const std::string& method) {
  return options.methods.empty() ||
         std::find(options.methods.begin(), options.methods.end(), method) != options.methods.end();
}

JobResult run_job(const StudyScene& scene, const StudySplit& split, const StudyOptions& options,
                  const std::vector<int>& lights) {
  Job job{scene, split, options, lights, {}};
  Stopwatch watch(scene.object, split.index, job.result.costs);
  const int most = *std::max_element(lights.begin(), lights.end());
  if (wanted(options, "mean")) {
    job.report("mean", 0, 0, std::nan(""), estimate_mean(split, options.floor));
  }
  watch.lap("mean");
  if (wanted(options, "paper") || wanted(options, "paper-map")) {
    const Chosen paper = choose(split.paper, scene.vertex_bins, Criterion::condition, most, 1);
    watch.lap("plan-condition");
    job.estimate("paper", scene.vertex_bins, paper, 0, false);
    watch.lap("fit-paper");
    job.estimate("paper-map", scene.vertex_bins, paper, 0, true);
    watch.lap("fit-paper-map");
  }
  if (wanted(options, "pixels-map")) {
    const Chosen pixels = choose(split.paper, scene.pixel_bins, Criterion::condition, most, 1);
    watch.lap("plan-pixels");
    job.estimate("pixels-map", scene.pixel_bins, pixels, 0, true);
    watch.lap("fit-pixels-map");
  }
  if (wanted(options, "a-optimal-map")) {
    const BrdfBasis basis =
        truncated(split.whole, std::min(planning_components, split.whole.components()));
    const Chosen best = choose(basis, scene.pixel_bins, Criterion::a_optimal, most, 1);
    watch.lap("plan-a-optimal");
    job.estimate("a-optimal-map", scene.pixel_bins, best, 0, true);
    watch.lap("fit-a-optimal-map");
  }
  if (wanted(options, "random") || wanted(options, "random-map")) {
    for (int run = 0; run < options.random_runs; ++run) {
      const std::uint64_t seed = options.seed * 7907 +
                                 static_cast<std::uint64_t>(split.index) * 131 +
                                 static_cast<std::uint64_t>(run);
      const Chosen random = draw(scene.vertex_bins, most, seed);
      job.estimate("random", scene.vertex_bins, random, run, false);
      job.estimate("random-map", scene.vertex_bins, random, run, true);
    }
    watch.lap("fit-random");
  }
  return std::move(job.result);
}

}  // namespace lightrig
