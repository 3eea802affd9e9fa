#pragma once

#include <CLI/CLI.hpp>
#include <functional>
#include <memory>
#include <utility>

#include "cli/verbs.h"

namespace lightrig::cli {

/// The verbs as they are being put together: each adds its options and what to run.
class Verbs {
 public:
  explicit Verbs(CLI::App& app) : app_(app) {}

  template <class Options>
  CLI::App* add(const char* name, const char* summary, std::shared_ptr<Options> options,
                int (*run)(const Options&)) {
    return add(name, summary, [options, run] { return run(*options); });
  }
  CLI::App* add(const char* name, const char* summary, std::function<int()> run) {
    CLI::App* verb = app_.add_subcommand(name, summary);
    verb->callback([this, run = std::move(run)] { chosen_ = run; });
    return verb;
  }
  int run_chosen() const { return chosen_ ? chosen_() : 2; }

 private:
  CLI::App& app_;
  std::function<int()> chosen_;
};

/// Adds --json.
CLI::App* with_json(CLI::App* verb, bool& json);
/// How the service is reached, and as whom, where nothing is typed and no $LIGHTRIG_SOCKET set.
ServiceOptions usual_service();
/// Adds --socket, --as and --json.
CLI::App* with_service(CLI::App* verb, ServiceOptions& options);
/// Adds --threads.
void add_threads(CLI::App* verb, int& threads);

void add_rig_verbs(Verbs& verbs);  ///< check, plan, dry-run, devices, simulate, backends, stability
void add_service_verbs(Verbs& verbs);  ///< what asks the service
void add_session_verbs(Verbs& verbs);  ///< reduce, verify, result, retake, compare, export
void add_library_verbs(Verbs& verbs);  ///< materials, calibrate, study

}  // namespace lightrig::cli
