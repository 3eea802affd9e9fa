#pragma once

#include <string>
#include <vector>

#include "daemon/session/session_folder.h"

namespace lightrig {

/// With what a shot was exposed, and why not with the rest of what was on offer.
struct ExposuresTold {
  std::vector<double>
      used;  ///< [s] of the lit frames that are merged, metering too, shortest first
  struct Skipped {
    double exposure = 0;  ///< [s]
    /// Shorter than what was needed: no lit pixel is so bright. Else longer: the darkest pixel
    /// worth measuring had the signal asked for.
    bool shorter = false;
  };
  std::vector<Skipped> skipped;  ///< shortest first
};
ExposuresTold exposures_told(const CapturedShot& shot);

/// "no lit pixel is too bright for a longer one", or its counterpart.
std::string reason_of(const ExposuresTold::Skipped& skipped);

}  // namespace lightrig
