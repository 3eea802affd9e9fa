#include "daemon/service/api.h"

namespace lightrig {
namespace {

// The page is one file, an HTML document between the marks of a raw string.
constexpr char page[] =
#include "daemon/service/panel/page.inc"
    ;

}  // namespace

Result<std::string> panel_page() { return std::string(page); }

}  // namespace lightrig
