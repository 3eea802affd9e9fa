#include "tests/paths.h"

namespace lightrig::test {

const char* const source_dir = LIGHTRIG_SOURCE_DIR;
const char* const build_dir = LIGHTRIG_BINARY_DIR;

}  // namespace lightrig::test
