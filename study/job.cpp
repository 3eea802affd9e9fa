#include "study/job.h"

#include <sys/resource.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <map>
#include <optional>
#include <random>
#include <span>
#include <tuple>

#include "core/planner.h"
#include "study/estimate.h"
#include "study/spheres.h"

namespace lightrig {
namespace {

/// [MiB]
double peak_memory() {
  rusage usage{};
  ::getrusage(RUSAGE_SELF, &usage);
  return static_cast<double>(usage.ru_maxrss) / 1024;
}

/// Seconds since the last call, put down under a stage's name.
class Stopwatch {
 public:
  Stopwatch(std::string object, int split, std::vector<CostRow>& costs)
      : object_(std::move(object)), split_(split), costs_(costs) {}
  void lap(const std::string& stage) {
    const auto now = std::chrono::steady_clock::now();
    costs_.push_back({object_, split_, stage, std::chrono::duration<double>(now - last_).count(),
                      peak_memory()});
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
  std::vector<double> condition;  ///< after each light, κ² of the paper's basis; NaN: not asked
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
constexpr int planning_components = 60;

int at_most(int wanted, const BrdfBasis& basis) {
  const int all = static_cast<int>(basis.components());
  return wanted > 0 ? std::min(wanted, all) : all;
}

class Job {
 public:
  Job(const StudyScene& scene, const StudySplit& split, const StudyOptions& options,
      const std::vector<int>& lights, const RigTime* rig)
      : scene_(scene),
        split_(split),
        options_(options),
        lights_(lights),
        rig_(rig),
        watch_(scene.object, split.index, result_.costs) {
    // Once for all splits.
    if (split.index == 0)
      result_.costs.push_back({scene.object, split.index, "bins", scene.seconds, peak_memory()});
  }

  void run(const MethodSpec& method) {
    using Lights = MethodSpec::Lights;
    if (method.lights == Lights::none) {
      without_lights(method);
    } else if (method.lights == Lights::random) {
      for (int run = 0; run < options_.random_runs; ++run) {
        const std::uint64_t seed = options_.seed * 7907 +
                                   static_cast<std::uint64_t>(split_.index) * 131 +
                                   static_cast<std::uint64_t>(run);
        fit_all(method, draw(bins(method), most(), seed), run);
      }
    } else {
      fit_all(method, planned(method), 0);
    }
    watch_.lap("reduce " + method.name);
  }

  /// Estimates at the largest number of lights, of the methods that are drawn.
  const std::map<std::string, std::vector<BrdfTable>>& drawn() const { return drawn_; }
  void draw_spheres_of(const std::vector<std::string>& names) { wanted_ = names; }
  JobResult take() { return std::move(result_); }
  Stopwatch& watch() { return watch_; }

 private:
  int most() const { return *std::max_element(lights_.begin(), lights_.end()); }
  const CandidateBins& bins(const MethodSpec& method) const {
    return method.pixels ? scene_.pixel_bins : scene_.vertex_bins;
  }

  /// Lights of the same criterion, points and components are chosen once.
  const Chosen& planned(const MethodSpec& method) {
    const bool condition = method.lights == MethodSpec::Lights::condition;
    const BrdfBasis& whole = condition ? split_.paper : split_.whole;
    const int k = at_most(
        condition || method.components > 0 ? method.components : planning_components, whole);
    const std::tuple<bool, bool, int> key{condition, method.pixels, k};
    if (const auto there = chosen_.find(key); there != chosen_.end()) return there->second;
    watch_.lap("other");
    Chosen chosen = choose(truncated(whole, k), bins(method),
                           condition ? Criterion::condition : Criterion::a_optimal, most(), 1);
    watch_.lap("plan " + method.name);
    if (!condition) condition_of_paper(method, chosen);
    watch_.lap("other");
    return chosen_.emplace(key, chosen).first->second;
  }

  /// κ² of the paper's basis at every reported number of lights that another criterion chose: what
  /// the column holds for every method.
  void condition_of_paper(const MethodSpec& method, Chosen& chosen) const {
    chosen.condition.assign(chosen.lights.size(), std::nan(""));
    for (const int n : lights_) {
      const auto count = static_cast<std::size_t>(n);
      if (count > chosen.lights.size()) continue;
      chosen.condition[count - 1] =
          conditioning(split_.paper, bins(method), std::span(chosen.lights.data(), count))
              .condition;
    }
  }

  void without_lights(const MethodSpec& method) {
    using Fit = MethodSpec::Fit;
    std::vector<MaterialResult> results;
    if (method.fit == Fit::mean) {
      results = estimate_mean(split_.whole, split_.test, options_.floor);
    } else if (method.fit == Fit::bivariate) {
      const bool any = std::any_of(split_.test.begin(), split_.test.end(),
                                   [](const Material& m) { return m.azimuth.size() > 0; });
      if (!any) return;  // a table without φd approximates nothing
      results = bivariate_error(split_.test, options_.floor);
    } else {
      std::vector<std::int32_t> cells;
      for (int cell = 0; cell < split_.paper.grid.cells(); ++cell) {
        if (split_.paper.valid[static_cast<std::size_t>(cell)] != 0) cells.push_back(cell);
      }
      results = estimate_paper(split_.paper, split_.test, cells, options_.floor);
    }
    report(method.name, 0, 0, std::nan(""), std::nan(""), results);
  }

  /// One light set under one estimator, at every reported number of lights.
  void fit_all(const MethodSpec& method, const Chosen& chosen, int run) {
    const bool map = method.fit == MethodSpec::Fit::map;
    const BrdfBasis& whole = !method.prior.empty() ? split_.priors.at(method.prior)
                             : map                 ? split_.whole
                                                   : split_.paper;
    const bool cut = method.components > 0 && method.components < whole.components();
    std::optional<BrdfBasis> changed;
    if (cut) changed = truncated(whole, method.components);
    if (method.bare_range) {
      if (!changed) changed = whole;
      changed->range_slack = 0;
    }
    const BrdfBasis& basis = changed ? *changed : whole;
    MeasuredRows measured{method.exposures >= 0 ? method.exposures : options_.exposures,
                          options_.metered, options_.noise, options_.floor, 0};
    const bool exact = measured.noise <= 0 && measured.exposures <= 0 && method.prior.empty();
    for (const int n : lights_) {
      if (n > static_cast<int>(chosen.lights.size())) continue;
      const std::span<const int> first(chosen.lights.data(), static_cast<std::size_t>(n));
      const std::vector<std::int32_t> cells = cells_of(bins(method), chosen.lights, first.size());
      measured.seed = options_.seed + 1009 * static_cast<std::uint64_t>(split_.index) +
                      static_cast<std::uint64_t>(n);
      const std::vector<MaterialResult> results =
          !exact ? estimate_measured(basis, split_.test, map, cells, measured)
          : map  ? estimate_map(basis, split_.test, cells, options_.floor)
                 : estimate_paper(basis, split_.test, cells, options_.floor);
      const double seconds = rig_ == nullptr ? std::nan("") : rig_->seconds(first);
      report(method.name, run, n, chosen.condition[first.size() - 1], seconds, results);
      const bool shown = std::find(wanted_.begin(), wanted_.end(), method.name) != wanted_.end();
      if (n != most() || !shown) continue;
      std::vector<BrdfTable>& tables = drawn_[method.name];
      if (!tables.empty()) continue;  // of random lights the first set
      for (const MaterialResult& r : results) tables.push_back(r.estimate);
    }
  }

  void report(const std::string& method, int run, int n, double condition, double seconds,
              const std::vector<MaterialResult>& materials) {
    for (std::size_t m = 0; m < materials.size(); ++m) {
      const MaterialResult& r = materials[m];
      result_.rows.push_back({scene_.object, split_.index, method, run, n, split_.test[m].name,
                              r.error.percent_log, r.error.percent_linear_cos,
                              r.error.median_abs_log, r.predicted, r.low, r.high, condition,
                              seconds});
    }
  }

  const StudyScene& scene_;
  const StudySplit& split_;
  const StudyOptions& options_;
  const std::vector<int>& lights_;
  const RigTime* rig_;
  JobResult result_;
  Stopwatch watch_;
  std::map<std::tuple<bool, bool, int>, Chosen> chosen_;
  std::vector<std::string> wanted_;
  std::map<std::string, std::vector<BrdfTable>> drawn_;
};

}  // namespace

JobResult run_job(const StudyScene& scene, const StudySplit& split, const StudyOptions& options,
                  std::span<const MethodSpec> methods, const std::vector<int>& lights,
                  const RigTime* rig) {
  Job job(scene, split, options, lights, rig);
  const std::vector<std::string> drawn = spheres_of(methods);
  // One picture per object is enough to look at.
  if (split.index == 0) job.draw_spheres_of(drawn);
  for (const MethodSpec& method : methods) job.run(method);
  const std::vector<std::byte> spheres = draw_spheres(split.test, drawn, job.drawn());
  job.watch().lap("spheres");
  JobResult result = job.take();
  result.spheres = spheres;
  return result;
}

}  // namespace lightrig
