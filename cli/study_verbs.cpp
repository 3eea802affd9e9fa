// stability: how the numbers hold up on stiff and extreme cases.
#include "cli/say.h"
#include "cli/verbs.h"
#include "study/stability.h"

namespace lightrig::cli {

int stability(bool json) {
  const StabilityReport report = run_stability();
  say(json ? stability_json(report) : stability_text(report));
  return report.failed() == 0 ? 0 : 1;
}

}  // namespace lightrig::cli
