// Any bytes as a rig file, and as a session file beside the rig they make.
#include <string>

#include "config/read_rig.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace lightrig;
  const std::string text(data, data + size);
  const Read<Rig> rig = read_rig_text(text, "/nowhere/rig.toml", NamedFiles::may_be_absent);
  for (const Diagnostic& one : rig.diagnostics) (void)to_text(one, rig.text);
  if (!rig.value) return 0;
  const Read<SessionSpec> spec =
      read_session_text(text, "/nowhere/session.toml", *rig.value, NamedFiles::may_be_absent);
  for (const Diagnostic& one : spec.diagnostics) (void)to_text(one, spec.text);
  const Read<SessionSpec> own = read_session({}, *rig.value, NamedFiles::may_be_absent);
  if (own.value) (void)effective_values(*rig.value, *own.value);
  return 0;
}
