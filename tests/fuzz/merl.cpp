// Any bytes as a MERL file; what is a table becomes a bivariate one as well.
#include <span>

#include "core/brdf_table.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace lightrig;
  MerlFindings findings;
  const auto table = decode_merl(std::as_bytes(std::span(data, size)), findings);
  if (table) (void)encode_merl(*table);
  return 0;
}
