// Seeded single faults over every wire and phase of a session. Each trial is a process of its own
// with a network of its own: it hosts a small rig at the far end of its wires, starts the service
// on it, and takes a session during which one fault strikes (tests/campaign/trial.h). Here they are
// drawn, run side by side, and counted.
//   fault_campaign [--count N] [--seed N] [--jobs N] [--wire NAME] [--patience X] [--verbose]
//   fault_campaign --wire NAME --fault "TEXT" [--seed N]      one trial, in this process
//   fault_campaign --loss [--seed N]      sessions that lose the camera's packets at random
// --patience multiplies the stated times: on a machine that does other work everything takes
// longer, and only one that does nothing else tells whether a session ends in its time.
#include <fmt/format.h>
#include <sys/wait.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <iterator>
#include <map>
#include <mutex>
#include <optional>
#include <thread>

#include "tests/campaign/trial.h"

namespace lightrig::campaign {
namespace {

constexpr int grace_s = 60;  ///< beyond its stated time, then a trial is killed

struct Options {
  int count = 300, jobs = 6;
  std::uint64_t seed = 1;
  double patience = 1;
  std::string wire;
  std::optional<std::string> fault;
  bool verbose = false, loss = false;
};

Options read_options(int argc, char** argv) {
  Options options;
  for (int i = 1; i < argc; ++i) {
    const std::string word = argv[i];
    const auto value = [&] {
      if (++i >= argc) die(word + " needs a value");
      return std::string(argv[i]);
    };
    if (word == "--count")
      options.count = std::stoi(value());
    else if (word == "--jobs")
      options.jobs = std::stoi(value());
    else if (word == "--seed")
      options.seed = std::stoull(value());
    else if (word == "--patience")
      options.patience = std::stod(value());
    else if (word == "--wire")
      options.wire = value();
    else if (word == "--fault")
      options.fault = value();
    else if (word == "--loss")
      options.loss = true;
    else if (word == "--verbose")
      options.verbose = true;
    else
      die("unknown option " + word +
          "; there are --count --jobs --seed --wire --fault --loss "
          "--patience --verbose");
  }
  if (options.fault && options.wire.empty()) die("--fault needs --wire");
  return options;
}

/// The trial in a process of its own; one that dies or hangs is an outcome too.
Outcome run_apart(const Trial& trial, double patience, const std::filesystem::path& folder) {
  const WireKind& kind = wire_kind(trial.wire);
  const std::string self = std::filesystem::read_symlink("/proc/self/exe").string();
  const std::string command = fmt::format(
      "timeout -k 5 {:.0f} env TMPDIR={} {} {} --wire {} --seed {} --patience {} --fault \"{}\" "
      "2>/dev/null",
      patience * (kind.stated_s + grace_s), folder.string(),
      kind.needs_umockdev ? "LD_PRELOAD=libumockdev-preload.so.0" : "", self, trial.wire,
      trial.seed, patience, trial.fault);
  FILE* pipe = popen(command.c_str(), "r");
  std::string text;
  std::array<char, 4096> buffer{};
  for (std::size_t n = 0; pipe && (n = std::fread(buffer.data(), 1, buffer.size(), pipe)) > 0;)
    text.append(buffer.data(), n);
  const int status = pipe ? pclose(pipe) : -1;
  const std::size_t line = text.rfind('{');
  auto outcome = line == std::string::npos ? std::nullopt : outcome_from(text.substr(line));
  if (outcome && (status == 0 || (WIFEXITED(status) && WEXITSTATUS(status) == 1))) return *outcome;
  Outcome died;
  died.verdict = "died";
  died.late = 1;
  died.violations = {fmt::format("the process did not end by itself (status {:#x})", status)};
  return died;
}

template <class Work>
void side_by_side(int jobs, int count, const Work& work) {
  std::atomic<int> next{0};
  std::vector<std::jthread> workers;
  for (int worker = 0; worker < std::min(jobs, count); ++worker)
    workers.emplace_back([&] {
      for (int n = next++; n < count; n = next++) work(n);
    });
}

/// Whether lost packets cost exposures, never data. The simulator counts the frames that its camera
/// began: one that was refused was begun anew.
bool bears_loss(const Options& options) {
  std::string folder = (std::filesystem::temp_directory_path() / "lightrig-loss-XXXXXX").string();
  if (!mkdtemp(folder.data())) die("no temporary folder can be made");
  const std::array<std::string, 3> losses{
      "loss share=0", fmt::format("loss share=0.01 seed={}", options.seed),
      fmt::format("loss share=0.01 resend=no seed={}", options.seed)};
  std::array<Outcome, 3> outcomes;
  side_by_side(3, 3, [&](int n) {
    const auto which = static_cast<std::size_t>(n);
    outcomes[which] = run_apart({"camera", losses[which], options.seed}, options.patience, folder);
  });
  std::error_code ignored;
  std::filesystem::remove_all(folder, ignored);
  bool good = true;
  for (std::size_t i = 0; i < outcomes.size(); ++i) {
    const Outcome& one = outcomes[i];
    std::printf("%-34s %s %s: %llu frames begun, %llu packets lost, %d wrong frames, %.1f s\n",
                losses[i].c_str(), one.verdict.c_str(), one.reason.c_str(),
                static_cast<unsigned long long>(one.counts.frames),
                static_cast<unsigned long long>(one.counts.packets_lost), one.wrong_frames,
                one.counts.seconds);
    for (const std::string& what : one.violations) std::printf("      %s\n", what.c_str());
    // Three tries are all that an exposure has: without resend a session may end, with the reason.
    good = good && (one.verdict == "completed" || i == 2) && one.violations.empty() &&
           (i == 0 || one.counts.packets_lost > 0);
  }
  return good && outcomes[1].counts.frames == outcomes[0].counts.frames &&
         outcomes[2].counts.frames > outcomes[0].counts.frames;
}

struct Tally {
  int trials = 0, completed = 0, paused = 0, aborted = 0, missed = 0, bad = 0;
  double worst = 0;
  void add(const Outcome& outcome) {
    ++trials;
    completed += outcome.verdict == "completed" ? 1 : 0;
    paused += outcome.verdict == "paused" ? 1 : 0;
    aborted += outcome.verdict == "aborted" ? 1 : 0;
    missed += outcome.phase.empty() ? 1 : 0;
    bad += outcome.violations.empty() ? 0 : 1;
    worst = std::max(worst, outcome.counts.seconds);
  }
};

class Campaign {
 public:
  explicit Campaign(const Options& options) : options_(options) {
    for (const WireKind& kind : wire_kinds())
      if (options.wire.empty() || options.wire == kind.name) kinds_.push_back(kind);
    if (kinds_.empty()) static_cast<void>(wire_kind(options.wire));  // says which there are
    std::string name = (std::filesystem::temp_directory_path() / "lightrig-faults-XXXXXX").string();
    if (!mkdtemp(name.data())) die("no temporary folder can be made");
    folder_ = name;
  }
  ~Campaign() {
    std::error_code ignored;
    std::filesystem::remove_all(folder_, ignored);
  }
  Campaign(const Campaign&) = delete;
  Campaign& operator=(const Campaign&) = delete;

  bool run() {
    measure_clean();
    side_by_side(options_.jobs, options_.count, [this](int n) {
      const Trial trial = draw(options_.seed, n, kinds_, clean_);
      note(n, trial, run_apart(trial, options_.patience, folder_));
    });
    report();
    return all_.bad == 0;
  }

 private:
  // Without a fault every wire completes; faults are drawn from all that then happens.
  void measure_clean() {
    clean_.resize(kinds_.size());
    side_by_side(options_.jobs, static_cast<int>(kinds_.size()), [this](int i) {
      const auto which = static_cast<std::size_t>(i);
      const Outcome outcome =
          run_apart({kinds_[which].name, "", options_.seed}, options_.patience, folder_);
      if (outcome.verdict != "completed" || !outcome.violations.empty())
        die(fmt::format("{}: even without a fault: {} {} {}", kinds_[which].name, outcome.verdict,
                        outcome.reason, fmt::join(outcome.violations, "; ")));
      clean_[which] = outcome.counts;
    });
    for (std::size_t i = 0; i < kinds_.size(); ++i)
      std::printf("%-6s without a fault: %.1f s, %llu requests, %llu frames; stated time %d s\n",
                  kinds_[i].name.c_str(), clean_[i].seconds,
                  static_cast<unsigned long long>(clean_[i].requests),
                  static_cast<unsigned long long>(clean_[i].frames), kinds_[i].stated_s);
    std::fflush(stdout);
  }

  void note(int n, const Trial& trial, const Outcome& outcome) {
    const std::lock_guard lock(mutex_);
    by_fault_[{trial.wire, trial.fault.substr(0, trial.fault.find(' '))}].add(outcome);
    by_phase_[outcome.phase.empty() ? "never" : outcome.phase].add(outcome);
    all_.add(outcome);
    wrong_ += outcome.wrong_frames;
    unsaid_ += outcome.lamp_on_unsaid;
    late_ += outcome.late;
    const bool bad = !outcome.violations.empty();
    if (!bad && !options_.verbose) return;
    std::printf("%s trial %d: --wire %s --seed %llu --fault \"%s\" (%s, %.1f s): %s %s\n",
                bad ? "BAD" : "   ", n, trial.wire.c_str(),
                static_cast<unsigned long long>(trial.seed), trial.fault.c_str(),
                outcome.phase.c_str(), outcome.counts.seconds, outcome.verdict.c_str(),
                outcome.reason.c_str());
    for (const std::string& what : outcome.violations) std::printf("      %s\n", what.c_str());
    std::fflush(stdout);
  }

  static void row(const std::string& first, const std::string& second, const Tally& tally) {
    std::printf("%-6s %-18s %7d %10d %7d %8d %11d %8.1f\n", first.c_str(), second.c_str(),
                tally.trials, tally.completed, tally.paused, tally.aborted, tally.missed,
                tally.worst);
  }

  void report() const {
    std::printf("%-6s %-18s %7s %10s %7s %8s %11s %8s\n", "wire", "fault", "trials", "completed",
                "paused", "aborted", "not struck", "worst s");
    for (const auto& [what, tally] : by_fault_) row(what.first, what.second, tally);
    std::printf("\n");
    for (const auto& [phase, tally] : by_phase_) row("phase", phase, tally);
    std::printf(
        "not struck: the session was over, or the wire gone, before the fault's moment came\n"
        "faults=%d completed=%d paused=%d aborted=%d wrong_frames=%d lamp_on_unsaid=%d late=%d "
        "not_struck=%d\n",
        all_.trials, all_.completed, all_.paused, all_.aborted, wrong_, unsaid_, late_,
        all_.missed);
  }

  const Options options_;
  std::filesystem::path folder_;  ///< of all trials, which leave things behind
  std::vector<WireKind> kinds_;
  std::vector<Clean> clean_;
  std::mutex mutex_;
  std::map<std::pair<std::string, std::string>, Tally> by_fault_;
  std::map<std::string, Tally> by_phase_;
  Tally all_;
  int wrong_ = 0, unsaid_ = 0, late_ = 0;
};

}  // namespace
}  // namespace lightrig::campaign

int main(int argc, char** argv) {
  using namespace lightrig::campaign;
  const Options options = read_options(argc, argv);
  if (options.loss) return bears_loss(options) ? 0 : 1;
  if (!options.fault) return Campaign(options).run() ? 0 : 1;
  const Outcome outcome = run_trial({options.wire, *options.fault, options.seed}, options.patience);
  std::printf("%s\n", to_json(outcome).c_str());
  std::fflush(stdout);
  std::_Exit(outcome.violations.empty() ? 0 : 1);
}
