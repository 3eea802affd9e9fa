#pragma once

#include <optional>
#include <string>

#include "config/read_rig.h"

namespace lightrig::cli {

/// The rig file and, where one is named, the session file, as read.
struct RigFiles {
  Read<Rig> rig;
  std::optional<Read<SessionSpec>> session;

  bool valid() const { return rig.value && (!session || session->value); }
  /// Only where valid().
  const SessionSpec& spec() const {
    return session ? *session->value : rig.value->session_defaults;
  }
};

/// `session` may be "".
RigFiles read_rig_files(const std::string& rig, const std::string& session);

/// Every diagnostic on standard error, with the source line and a caret.
void show_diagnostics(const RigFiles& files);

}  // namespace lightrig::cli
