// Any bytes as a plan.json.
#include <string>

#include "daemon/session/plan_json.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  (void)lightrig::plan_from_json(std::string(data, data + size));
  return 0;
}
