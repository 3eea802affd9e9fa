// check and backends: what a rig file says, and what this build can do with it.
#include <fmt/format.h>

#include "cli/json_fields.h"
#include "cli/rig_files.h"
#include "cli/say.h"
#include "cli/verbs.h"
#include "drivers/devices.h"

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

// The name of a backend's build option where the rig names real hardware; "" for what is simulated.
std::vector<std::string> backends_needed(const Rig& rig) {
  std::vector<std::string> names;
  if (std::holds_alternative<ModbusGantry>(rig.gantry.backend) ||
      std::holds_alternative<ModbusLamp>(rig.lamp.backend))
    names.emplace_back("modbus");
  if (std::holds_alternative<GrblGantry>(rig.gantry.backend)) names.emplace_back("usb");
  if (std::holds_alternative<AravisCamera>(rig.camera.backend)) names.emplace_back("aravis");
  return names;
}

int tell_backends_needed(const Rig& rig) {
  int absent = 0;
  for (const std::string& name : backends_needed(rig))
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
  const auto all = lightrig::backends();
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
  say(text + "sim      built in (always)");
  return 0;
}

}  // namespace lightrig::cli
