#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <chrono>
#include <map>
#include <mutex>
#include <numbers>
#include <optional>
#include <thread>

#include "config/load_materials.h"
#include "core/parallel.h"
#include "daemon/session/durable_file.h"
#include "daemon/session/input_hash.h"
#include "study/report.h"
#include "study/store.h"
#include "study/study.h"

namespace lightrig {
namespace {

Result<void> check_options(const StudyOptions& o) {
  const auto bad = [](std::string message) {
    return fail(ErrorCode::invalid_input, "study: " + std::move(message));
  };
  if (o.out.empty()) return bad("name a folder to write to (-o DIR)");
  if (o.splits < 1 || o.candidates < 1 || o.components < 1 || o.max_lights < 1 ||
      o.random_runs < 0 || o.threads < 1) {
    return bad("splits, candidates, components, lights and threads must be at least 1");
  }
  if (o.shard_count < 1 || o.shard_index < 0 || o.shard_index >= o.shard_count) {
    return bad(fmt::format("shard {} of {} does not exist; shards are 1/n … n/n", o.shard_index + 1,
                           o.shard_count));
  }
  if (!(o.floor > 0)) return bad("the floor of the logarithm must be positive");
  for (const int n : o.lights) {
    if (n < 1) return bad(fmt::format("{} lights asked for; at least 1", n));
  }
  return {};
}

/// Objects with the numbers of lights to report for each.
std::map<std::string, std::vector<int>> asked_objects(const StudyOptions& o,
                                                      std::vector<std::string>& order) {
  std::map<std::string, std::vector<int>> lights;
  if (o.table1) {
    for (const Table1Entry& entry : table1_entries()) {
      order.push_back(entry.object);
      lights[entry.object] = {entry.lights[0], entry.lights[1]};
    }
    return lights;
  }
  std::vector<int> numbers = o.lights;
  if (numbers.empty()) {
    for (int n = 1; n <= o.max_lights; ++n) numbers.push_back(n);
  }
  std::sort(numbers.begin(), numbers.end());
  numbers.erase(std::unique(numbers.begin(), numbers.end()), numbers.end());
  for (const std::string& object : o.objects) {
    if (lights.emplace(object, numbers).second) order.push_back(object);
  }
  return lights;
}

std::vector<std::uint8_t> valid_in_all(const std::vector<Material>& materials) {
  std::vector<std::uint8_t> valid(static_cast<std::size_t>(materials[0].table.grid.cells()), 1);
  for (const Material& material : materials) {
    for (std::size_t cell = 0; cell < valid.size(); ++cell) {
      if (!material.table.f.row(static_cast<Eigen::Index>(cell)).isFinite().all()) valid[cell] = 0;
    }
  }
  return valid;
}

StudyIdentity identity_of(const StudyOptions& o, const std::vector<Material>& materials,
                          const std::vector<StudyScene>& scenes,
                          const std::vector<std::vector<int>>& lights,
                          const std::vector<MethodSpec>& specs, const RigTime* rig) {
  StudyIdentity identity;
  identity.splits = o.splits;
  std::vector<std::string> methods;
  for (const MethodSpec& m : specs) methods.push_back(m.name);
  identity.text = fmt::format(
      "schema=lightrig.study/5\nmaterials={}\nmaterial_count={}\nmaterials_sha256={}\n"
      "splits={}\ntrain_fraction={}\nrandom_runs={}\ncandidates={}\ncomponents={}\nfloor={}\n"
      "exposures={}\nmetered={}\nnoise={}\nseed={}\nmethods={}\ntable1={}\nseconds_per_light={}\n",
      o.materials == "builtin" ? "builtin" : "directory", materials.size(),
      materials_hash(materials), o.splits, o.train_fraction, o.random_runs, o.candidates,
      o.components, o.floor, o.exposures, o.metered ? 1 : 0, o.noise, o.seed,
      fmt::join(methods, " "), o.table1 ? 1 : 0, o.seconds_per_light);
  if (rig != nullptr) {
    identity.text +=
        fmt::format("rig={}\nrig_sha256={}\n", rig->rig().name, sha256_hex(rig->rig().text));
  }
  for (std::size_t i = 0; i < scenes.size(); ++i) {
    identity.objects.push_back(scenes[i].object);
    identity.lights.push_back(lights[i]);
    identity.text +=
        fmt::format("object {}={}\nmesh_sha256 {}={}\n", scenes[i].object,
                    fmt::join(lights[i], " "), scenes[i].object, scenes[i].mesh_sha256);
  }
  return identity;
}

/// Everything the jobs share.
struct Prepared {
  std::vector<Material> materials;
  std::vector<StudyScene> scenes;
  std::vector<std::vector<int>> lights;
  std::vector<std::string> remarks;
  std::vector<MethodSpec> methods;
  std::optional<RigTime> rig;
  StudyIdentity identity;
};

Result<Prepared> prepare_study(const StudyOptions& options) {
  Prepared p;
  Result<std::vector<MethodSpec>> methods = methods_of(options);
  if (!methods) return tl::unexpected(methods.error());
  p.methods = std::move(*methods);
  if (!options.rig.empty()) {
    Result<RigTime> rig = RigTime::open(options.rig, lights_over_sphere(options.candidates));
    if (!rig) return tl::unexpected(rig.error());
    p.remarks.push_back(fmt::format(
        "capture times are of rig \"{}\": the candidate nearest to a light asked for is {:.1f}° "
        "from it (median over all)",
        rig->rig().name, rig->median_deviation() * 180 / std::numbers::pi));
    p.rig.emplace(std::move(*rig));
  }
  MaterialsConfig config;
  config.source = options.materials;
  Result<LoadedMaterials> loaded = load_materials(config);
  if (!loaded) return tl::unexpected(with_context("study", loaded.error()));
  p.materials = std::move(loaded->materials);
  p.remarks.insert(p.remarks.end(), loaded->remarks.begin(), loaded->remarks.end());
  const std::vector<std::uint8_t> valid = valid_in_all(p.materials);
  std::vector<std::string> order;
  const std::map<std::string, std::vector<int>> lights = asked_objects(options, order);
  for (const std::string& object : order) {
    Result<StudyScene> scene = make_scene(object, options, p.materials[0].table.grid, valid);
    if (!scene) {
      // Table 1 goes on without the meshes that are not there; an object asked for by name is an
      // error.
      if (!options.table1) return tl::unexpected(scene.error());
      p.remarks.push_back(scene.error().message);
      continue;
    }
    p.scenes.push_back(std::move(*scene));
    p.lights.push_back(lights.at(object));
  }
  if (p.scenes.empty()) return fail(ErrorCode::invalid_input, "study: no object to study");
  p.identity =
      identity_of(options, p.materials, p.scenes, p.lights, p.methods, p.rig ? &*p.rig : nullptr);
  return p;
}

/// This shard's jobs that are not stored yet, as (split, object) indices.
std::vector<std::pair<int, int>> open_jobs(const StudyOptions& o, const Prepared& p, int& mine) {
  std::vector<std::pair<int, int>> jobs;
  mine = 0;
  const int objects = static_cast<int>(p.scenes.size());
  for (int job = 0; job < o.splits * objects; ++job) {
    if (job % o.shard_count != o.shard_index) continue;
    ++mine;
    const int split = job / objects, object = job % objects;
    std::error_code ignored;
    const std::string& name = p.scenes[static_cast<std::size_t>(object)].object;
    if (!std::filesystem::exists(job_file(o.out, split, name), ignored)) {
      jobs.emplace_back(split, object);
    }
  }
  return jobs;
}

/// Bases of the splits in work: made once, dropped with their last job.
class SplitCache {
 public:
  SplitCache(const Prepared& prepared, const StudyOptions& options)
      : prepared_(prepared), options_(options) {}
  Result<std::shared_ptr<const StudySplit>> get(int index) {
    const std::scoped_lock lock(mutex_);
    if (auto there = splits_[index].lock()) return there;
    Result<StudySplit> made = make_split(prepared_.materials, options_, prepared_.methods, index);
    if (!made) return tl::unexpected(made.error());
    if (Result<void> stored = store_split(options_.out, *made); !stored) {
      return tl::unexpected(stored.error());
    }
    auto shared = std::make_shared<const StudySplit>(std::move(*made));
    splits_[index] = shared;
    latest_[static_cast<std::size_t>(index) % latest_.size()] = shared;
    return shared;
  }

 private:
  const Prepared& prepared_;
  const StudyOptions& options_;
  std::mutex mutex_;
  std::map<int, std::weak_ptr<const StudySplit>> splits_;
  std::array<std::shared_ptr<const StudySplit>, 2>
      latest_;  // the next job mostly asks for it again
};

/// Every file that a shard may hold of a study, and where it goes; a job's rows last.
std::vector<std::pair<std::filesystem::path, std::filesystem::path>> files_of(
    const StudyIdentity& identity, const std::filesystem::path& shard,
    const std::filesystem::path& out) {
  std::vector<std::pair<std::filesystem::path, std::filesystem::path>> files;
  for (int split = 0; split < identity.splits; ++split) {
    files.emplace_back(split_file(shard, split), split_file(out, split));
    for (const std::string& object : identity.objects) {
      files.emplace_back(spheres_file(shard, object), spheres_file(out, object));
      files.emplace_back(cost_file(shard, split, object), cost_file(out, split, object));
      files.emplace_back(job_file(shard, split, object), job_file(out, split, object));
    }
  }
  return files;
}

}  // namespace

Result<StudySummary> run_study(const StudyOptions& options,
                               const std::function<void(const StudyProgress&)>& progress) {
  if (Result<void> sound = check_options(options); !sound) return tl::unexpected(sound.error());
  const auto start = std::chrono::steady_clock::now();
  Result<Prepared> p = prepare_study(options);
  if (!p) return tl::unexpected(p.error());
  if (Result<void> claimed = claim_folder(options.out, p->identity); !claimed) {
    return tl::unexpected(claimed.error());
  }
  int mine = 0;
  const std::vector<std::pair<int, int>> jobs = open_jobs(options, *p, mine);
  SplitCache splits(*p, options);
  std::mutex mutex;
  std::optional<Error> failure;
  int done = 0;
  parallel_ranges(
      static_cast<std::int64_t>(jobs.size()), 1, options.threads,
      [&](std::int64_t first, std::int64_t, int) {
        {
          const std::scoped_lock lock(mutex);
          if (failure) return;
        }
        const auto [index, object] = jobs[static_cast<std::size_t>(first)];
        const StudyScene& scene = p->scenes[static_cast<std::size_t>(object)];
        const auto split = splits.get(index);
        Result<void> stored;
        if (!split) {
          stored = tl::unexpected(split.error());
        } else {
          const JobResult result =
              run_job(scene, **split, options, p->methods,
                      p->lights[static_cast<std::size_t>(object)], p->rig ? &*p->rig : nullptr);
          stored = store_job(options.out, index, scene.object, result);
        }
        const std::scoped_lock lock(mutex);
        if (!stored) {
          failure = stored.error();
          return;
        }
        ++done;
        if (!progress) return;
        const double elapsed =
            std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
        const int open = static_cast<int>(jobs.size());
        progress({mine - open + done, mine, fmt::format("{} split {}", scene.object, index + 1),
                  elapsed, elapsed / done * (open - done)});
      });
  if (failure) return tl::unexpected(with_context("study", *failure));
  Result<StudySummary> summary = summarize_study(options.out);
  if (summary) {
    summary->remarks.insert(summary->remarks.begin(), p->remarks.begin(), p->remarks.end());
  }
  return summary;
}

Result<StudySummary> merge_study(std::span<const std::filesystem::path> shards,
                                 const std::filesystem::path& out) {
  if (shards.empty()) return fail(ErrorCode::invalid_input, "study merge: no shard given");
  for (const std::filesystem::path& shard : shards) {
    const Result<StudyIdentity> identity = read_identity(shard);
    if (!identity) return tl::unexpected(with_context("study merge", identity.error()));
    if (Result<void> same = claim_folder(out, *identity); !same) {
      return tl::unexpected(with_context("study merge: " + shard.string(), same.error()));
    }
    for (const auto& [from, to] : files_of(*identity, shard, out)) {
      const Result<std::string> bytes = read_file(from);
      if (!bytes) continue;  // another shard's job
      if (Result<void> w = write_durably(to, *bytes); !w) {
        return tl::unexpected(with_context("study merge", w.error()));
      }
    }
  }
  return summarize_study(out);
}

Result<StudySummary> summarize_study(const std::filesystem::path& out) {
  Result<StoredStudy> study = read_study(out);
  if (!study) return tl::unexpected(study.error());
  StudySummary summary;
  summary.jobs_done = study->jobs_there;
  summary.jobs_total = study->identity.jobs();
  summary.complete = summary.jobs_done == summary.jobs_total;
  summary.text = study_text(*study);
  if (!summary.complete) return summary;
  std::string rows = study_header(), costs = cost_header();
  for (const StudyRow& row : study->rows) rows += to_csv(row);
  for (const CostRow& row : study->costs) costs += to_csv(row);
  const std::pair<const char*, std::string> files[] = {
      {"study.csv", rows},
      {"splits.csv", split_header() + study->splits},
      {"cost.csv", costs},
      {"report.html", study_html(*study)}};
  for (const auto& [name, text] : files) {
    if (Result<void> w = write_durably(out / name, text); !w) {
      return tl::unexpected(with_context("study", w.error()));
    }
    summary.files.push_back(out / name);
  }
  return summary;
}

}  // namespace lightrig
