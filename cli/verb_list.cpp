// Options that many verbs share.
#include "cli/verb_list.h"

#include <unistd.h>

#include <cstdlib>
#include <string>

namespace lightrig::cli {
namespace {

// More than any machine of a rig has, and few enough for the system to grant them.
constexpr int most_threads = 1024;

std::string user_name() {
  for (const char* name : {"LIGHTRIG_OPERATOR", "USER", "LOGNAME"})
    if (const char* value = std::getenv(name); value != nullptr && *value != '\0') return value;
  return "uid " + std::to_string(getuid());
}

}  // namespace

CLI::App* with_json(CLI::App* verb, bool& json) {
  verb->add_flag("--json", json, "Answer in JSON");
  return verb;
}

ServiceOptions usual_service() { return {"/run/lightrig/control.sock", user_name(), false}; }

CLI::App* with_service(CLI::App* verb, ServiceOptions& options) {
  options = usual_service();
  verb->add_option("--socket", options.socket, "Control socket of the service")
      ->envname("LIGHTRIG_SOCKET")
      ->default_str(options.socket);
  verb->add_option("--as", options.as, "Your name, for the lock and the record");
  return with_json(verb, options.json);
}

void add_threads(CLI::App* verb, int& threads) {
  verb->add_option("--threads", threads, "Threads; all where none is given")
      ->check(CLI::Range(1, most_threads));
}

}  // namespace lightrig::cli
