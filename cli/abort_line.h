#pragma once

#include <optional>
#include <string>
#include <vector>

#include "cli/verbs.h"

namespace lightrig::cli {

/// An `abort` as it was typed, however badly.
struct AbortLine {
  ServiceOptions service;
  std::string reason;  ///< of --reason and of every word that is left over
  /// What could not be made sense of, to be complained about once the ABORT is out.
  std::vector<std::string> unknown;
};

/// What a command line says of an ABORT; empty where its verb is another. `otherwise` is what holds
/// where the line does not say how to reach the service.
std::optional<AbortLine> read_abort_line(const std::vector<std::string>& words,
                                         const ServiceOptions& otherwise);

}  // namespace lightrig::cli
