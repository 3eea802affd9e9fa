// study and stability: experiments that need no rig.
#include <fmt/format.h>

#include <charconv>
#include <cstdio>
#include <filesystem>
#include <thread>

#include "cli/say.h"
#include "cli/verbs.h"
#include "study/stability.h"
#include "study/study.h"

namespace lightrig::cli {
namespace {

// "2/8": the second of eight, counted from 1 as people do.
bool read_shard(const std::string& text, StudyOptions& options) {
  if (text.empty()) return true;
  const auto slash = text.find('/');
  if (slash == std::string::npos) return false;
  int index = 0, count = 0;
  const char* begin = text.data();
  const char* end = begin + text.size();
  const auto first = std::from_chars(begin, begin + slash, index);
  const auto second = std::from_chars(begin + slash + 1, end, count);
  if (first.ptr != begin + slash || second.ptr != end || index < 1 || index > count) return false;
  options.shard_index = index - 1;
  options.shard_count = count;
  return true;
}

void show(const StudyProgress& progress) {
  constexpr int width = 24;
  const int filled = progress.jobs_total > 0 ? width * progress.jobs_done / progress.jobs_total : 0;
  std::string bar;
  for (int i = 0; i < width; ++i) bar += i < filled ? "█" : "·";
  const std::string line =
      fmt::format("{}{}/{} jobs  {} left  {}", on_terminal() ? bar + " " : "", progress.jobs_done,
                  progress.jobs_total, duration(progress.remaining_s), progress.job);
  // Standard error: the table on standard output stays clean.
  std::fprintf(stderr, on_terminal() ? "\r\x1b[K%s" : "%s\n", line.c_str());
}

int tell(const Result<StudySummary>& summary) {
  if (!summary) return complain(with_context("study", summary.error()));
  for (const std::string& remark : summary->remarks) complain(remark);
  say(summary->text);
  if (!summary->complete)
    say(fmt::format("{} of {} jobs are done; run the other shards, then lightrig study merge",
                    summary->jobs_done, summary->jobs_total));
  for (const auto& file : summary->files) say("written " + file.string());
  return 0;
}

}  // namespace

int study(const StudyVerbOptions& typed) {
  StudyOptions options;
  options.objects = typed.objects;
  options.meshes = typed.meshes;
  options.materials = typed.materials;
  options.methods = typed.methods;
  options.lights = typed.lights;
  options.criteria = typed.criteria;
  options.estimators = typed.estimators;
  options.component_counts = typed.component_counts;
  options.exposure_counts = typed.exposure_counts;
  options.rig = typed.rig;
  options.table1 = typed.table1;
  options.splits = typed.splits;
  options.random_runs = typed.random_runs;
  options.candidates = typed.candidates;
  options.components = typed.components;
  options.exposures = typed.exposures;
  options.metered = !typed.around_median;
  options.noise = typed.noise;
  options.floor = typed.floor;
  options.seed = typed.seed;
  options.out = typed.output;
  options.threads = typed.threads > 0
                        ? typed.threads
                        : static_cast<int>(std::max(1U, std::thread::hardware_concurrency()));
  if (!read_shard(typed.shard, options)) {
    complain("--shard takes i/n with 1 ≤ i ≤ n, as in 2/8");
    return 2;
  }
  const auto summary = run_study(options, show);
  if (on_terminal()) std::fputc('\n', stderr);
  return tell(summary);
}

int study_merge(const std::vector<std::string>& shards, const std::string& output) {
  const std::vector<std::filesystem::path> folders(shards.begin(), shards.end());
  return tell(merge_study(folders, output));
}

int stability(bool json) {
  const StabilityReport report = run_stability();
  say(json ? stability_json(report) : stability_text(report));
  return report.failed() == 0 ? 0 : 1;
}

}  // namespace lightrig::cli
