#include "core/result.h"

namespace lightrig {

std::string_view name_of(ErrorCode code) {
  switch (code) {
    case ErrorCode::invalid_input:
      return "invalid_input";
    case ErrorCode::not_built:
      return "not_built";
    case ErrorCode::not_found:
      return "not_found";
    case ErrorCode::disconnected:
      return "disconnected";
    case ErrorCode::timed_out:
      return "timed_out";
    case ErrorCode::refused:
      return "refused";
    case ErrorCode::stopped:
      return "stopped";
    case ErrorCode::no_space:
      return "no_space";
  }
  return "unknown";
}

}  // namespace lightrig
