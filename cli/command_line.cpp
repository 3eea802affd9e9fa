// `lightrig` as it is typed: the verbs put together, one of them run.
#include "cli/command_line.h"

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <string>
#include <vector>

#include "cli/abort_line.h"
#include "cli/verb_list.h"
#include "config/suggest.h"

namespace lightrig::cli {
namespace {

std::vector<std::string> names_of(const CLI::App& app) {
  std::vector<std::string> names;
  for (const CLI::App* verb : app.get_subcommands({})) names.push_back(verb->get_name());
  return names;
}

// CLI11 knows that a word is unknown, not which one was meant.
int usage_error(const CLI::App& app, const CLI::ParseError& error, int argc, char** argv) {
  const std::vector<std::string> names = names_of(app);
  const std::string word = argc > 1 ? argv[1] : "";
  const bool known = std::find(names.begin(), names.end(), word) != names.end();
  if (!known && !word.empty() && word.front() != '-') {
    const std::string hint = did_you_mean(word, names);
    std::fprintf(stderr, "lightrig: there is no verb \"%s\"%s%s; lightrig --help lists them\n",
                 word.c_str(), hint.empty() ? "" : "; ", hint.c_str());
    return 2;
  }
  if (error.get_exit_code() == 0) return app.exit(error);  // help or version, as asked
  // What comes of typing is said as everything else is: who speaks, what is wrong, where to look.
  std::fprintf(stderr, "lightrig: %s; lightrig %s--help shows what it takes\n", error.what(),
               known ? (word + " ").c_str() : "");
  return 2;
}

// An ABORT goes out whatever else stands on its line: who types it in a hurry has no time to be
// corrected. What is wrong with the line is said afterwards.
int abort_whatever_else(const AbortLine& line) {
  const int code = abort(line.service, line.reason);
  for (const std::string& what : line.unknown)
    std::fprintf(stderr,
                 "lightrig: abort left %s aside; lightrig abort --help shows what it takes\n",
                 what.c_str());
  return code;
}

}  // namespace

int run(int argc, char** argv) {
  CLI::App app{"Plans the few lights that suffice, captures them, reconstructs the BRDF",
               "lightrig"};
  app.set_version_flag("--version", LIGHTRIG_VERSION);
  app.require_subcommand(1);
  app.get_formatter()->column_width(28);
  Verbs verbs(app);
  add_rig_verbs(verbs);
  add_service_verbs(verbs);
  add_session_verbs(verbs);
  add_library_verbs(verbs);
  std::string shell;
  CLI::App* verb = verbs.add("completion", "Print a completion script for a shell",
                             [&] { return completion(shell, names_of(app)); });
  verb->add_option("shell", shell, "bash, zsh or fish")
      ->required()
      ->check(CLI::IsMember({"bash", "zsh", "fish"}));
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    const bool help = error.get_exit_code() == 0;
    ServiceOptions service = usual_service();
    if (const char* socket = std::getenv("LIGHTRIG_SOCKET"); socket != nullptr && *socket != '\0')
      service.socket = socket;
    if (const auto line = read_abort_line({argv + 1, argv + argc}, service); line && !help)
      return abort_whatever_else(*line);
    return usage_error(app, error, argc, argv);
  }
  return verbs.run_chosen();
}

}  // namespace lightrig::cli
