// check and backends: what a rig file says, and what this build can do with it.
#include <fmt/format.h>

#include "cli/json_fields.h"
#include "cli/panel_backend.h"
#include "cli/rig_files.h"
#include "cli/say.h"
#include "cli/verbs.h"
#include "config/json_text.h"
#include "config/load_materials.h"
#include "config/load_object.h"
#include "drivers/backends.h"
#include "sim/open_devices.h"

namespace lightrig::cli {
namespace {

void add_json(Json& list, const std::vector<Diagnostic>& diagnostics) {
  for (const Diagnostic& one : diagnostics)
    list.push_back({{"severity", one.severity == Diagnostic::Severity::error ? "error" : "warning"},
                    {"file", one.file.string()},
                    {"line", one.line},
                    {"column", one.column},
                    {"message", one.message},
                    {"suggestion", one.suggestion}});
}

int tell_backends_needed(const Rig& rig) {
  int absent = 0;
  for (const std::string& name : backends_named_by(rig))
    for (const Backend& backend : lightrig::backends())
      if (backend.name == name && !backend.built) {
        complain(fmt::format("the rig names a device of the backend \"{}\", but {}", name,
                             backend.remedy));
        ++absent;
      }
  return absent;
}

// What the files name, as far as it can be judged without a plan; one line per mistake.
std::vector<std::string> mistakes_in_contents(const Rig& rig, const SessionSpec& spec) {
  std::vector<std::string> mistakes;
  if (const auto object = load_object(spec.object); !object)
    mistakes.push_back(object.error().message);
  if (const auto files = count_material_files(spec.materials); !files)
    mistakes.push_back(files.error().message);
  if (rig.simulation)
    if (const auto truth = sim::truth_of(rig); !truth) mistakes.push_back(truth.error().message);
  return mistakes;
}

}  // namespace

int check(const CheckOptions& options) {
  const RigFiles files = read_rig_files(options.rig, options.session);
  const int absent = files.rig.value ? tell_backends_needed(*files.rig.value) : 0;
  const std::vector<std::string> mistakes =
      files.valid() ? mistakes_in_contents(*files.rig.value, files.spec())
                    : std::vector<std::string>();
  const bool usable = files.valid() && mistakes.empty() && absent == 0;
  if (options.json) {
    Json list = Json::array();
    add_json(list, files.rig.diagnostics);
    if (files.session) add_json(list, files.session->diagnostics);
    say(json_text(Json{{"valid", files.valid() && mistakes.empty()},
                       {"backends_absent", absent},
                       {"contents", mistakes},
                       {"diagnostics", std::move(list)}}));
    return usable ? 0 : 1;
  }
  show_diagnostics(files);
  if (!files.valid()) return 1;
  for (const std::string& mistake : mistakes) complain(fmt::format("{}: {}", options.rig, mistake));
  if (!mistakes.empty()) return 1;
  if (options.print)
    for (const std::string& line : effective_values(*files.rig.value, files.spec())) say(line);
  say(fmt::format("{}: valid{}{}", options.rig,
                  options.session.empty() ? "" : ", and so is " + options.session,
                  absent == 0 ? "" : ", but this build cannot open the rig"));
  return usable ? 0 : 1;
}

int backends(bool json) {
  std::vector<Backend> all = lightrig::backends();
  all.push_back(panel_backend());
  all.push_back({"sim", true, ""});  // the laboratory in memory is part of every build
  if (json) {
    Json list = Json::array();
    for (const Backend& one : all)
      list.push_back({{"name", one.name}, {"built", one.built}, {"remedy", one.remedy}});
    say(json_text(list));
    return 0;
  }
  std::string text;
  for (const Backend& one : all)
    text += fmt::format("{:<8} {}\n", one.name, one.built ? "built in" : "absent: " + one.remedy);
  say(text);
  return 0;
}

}  // namespace lightrig::cli
