// check and backends: what a rig file says, and what this build can do with it.
#include <fmt/format.h>

#include "cli/json_fields.h"
#include "cli/panel_backend.h"
#include "cli/rig_files.h"
#include "cli/say.h"
#include "cli/verbs.h"
#include "drivers/backends.h"

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
        complain(fmt::format("the rig names a {} device, but {}", name, backend.remedy));
        ++absent;
      }
  return absent;
}

}  // namespace

int check(const CheckOptions& options) {
  const RigFiles files = read_rig_files(options.rig, options.session);
  const int absent = files.rig.value ? tell_backends_needed(*files.rig.value) : 0;
  if (options.json) {
    Json list = Json::array();
    add_json(list, files.rig.diagnostics);
    if (files.session) add_json(list, files.session->diagnostics);
    say(Json{{"valid", files.valid()}, {"diagnostics", std::move(list)}}.dump());
    return files.valid() && absent == 0 ? 0 : 1;
  }
  show_diagnostics(files);
  if (!files.valid()) return 1;
  if (options.print)
    for (const std::string& line : effective_values(*files.rig.value, files.spec())) say(line);
  say(fmt::format("{}: valid{}", options.rig,
                  options.session.empty() ? "" : ", and so is " + options.session));
  return absent == 0 ? 0 : 1;
}

int backends(bool json) {
  std::vector<Backend> all = lightrig::backends();
  all.push_back(panel_backend());
  all.push_back({"sim", true, ""});  // the laboratory in memory is part of every build
  if (json) {
    Json list = Json::array();
    for (const Backend& one : all)
      list.push_back({{"name", one.name}, {"built", one.built}, {"remedy", one.remedy}});
    say(list.dump());
    return 0;
  }
  std::string text;
  for (const Backend& one : all)
    text += fmt::format("{:<8} {}\n", one.name, one.built ? "built in" : "absent: " + one.remedy);
  say(text);
  return 0;
}

}  // namespace lightrig::cli
