#include "daemon/session/exposures_told.h"

#include <algorithm>
#include <cmath>

namespace lightrig {

ExposuresTold exposures_told(const CapturedShot& shot) {
  ExposuresTold told;
  double longest = 0;  // of those that the metering frame asked for
  for (const StoredFrame& frame : shot.frames) {
    if (frame.role != "bracket" && frame.role != "metering") continue;
    told.used.push_back(frame.exposure);
    if (frame.role == "bracket") longest = std::max(longest, frame.exposure);
  }
  std::ranges::sort(told.used);
  if (longest == 0 && !told.used.empty()) longest = told.used.back();  // the metering frame itself
  for (const double exposure : shot.exposures_skipped) {
    // A camera rounds what it is asked for; journals of before name the metering frame's as
    // skipped.
    const bool taken = std::ranges::any_of(
        told.used, [&](double used) { return std::abs(used - exposure) < 0.05 * exposure; });
    // What is needed is one run of those on offer, so that the rest lie on either side of any of
    // it.
    if (!taken) told.skipped.push_back({exposure, exposure < longest});
  }
  std::ranges::sort(told.skipped, {}, &ExposuresTold::Skipped::exposure);
  return told;
}

std::string reason_of(const ExposuresTold::Skipped& skipped) {
  return skipped.shorter ? "no lit pixel is too bright for a longer one"
                         : "the darkest pixel has its signal-to-noise without it";
}

}  // namespace lightrig
