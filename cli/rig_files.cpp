#include "cli/rig_files.h"

#include <cstdio>

namespace lightrig::cli {
namespace {

void show(const std::vector<Diagnostic>& diagnostics, const std::string& text) {
  for (const Diagnostic& one : diagnostics)
    std::fprintf(stderr, "%s\n", to_text(one, text).c_str());
}

}  // namespace

RigFiles read_rig_files(const std::string& rig, const std::string& session) {
  RigFiles files{read_rig(rig), {}};
  if (files.rig.value && !session.empty()) files.session = read_session(session, *files.rig.value);
  return files;
}

void show_diagnostics(const RigFiles& files) {
  show(files.rig.diagnostics, files.rig.text);
  if (files.session) show(files.session->diagnostics, files.session->text);
}

}  // namespace lightrig::cli
