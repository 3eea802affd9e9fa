#include <nlohmann/json.hpp>

#include "config/json_text.h"
#include "daemon/service/http.h"

namespace lightrig {
namespace {

int status_of(ErrorCode code) {
  switch (code) {
    case ErrorCode::invalid_input:
      return 422;
    case ErrorCode::not_built:
      return 501;
    case ErrorCode::not_found:
      return 404;
    case ErrorCode::disconnected:
      return 503;
    case ErrorCode::timed_out:
      return 504;
    case ErrorCode::refused:
    case ErrorCode::stopped:
      return 409;
    case ErrorCode::no_space:
      return 507;
  }
  return 500;
}

}  // namespace

const std::string& HttpRequest::header(const std::string& lower_case_name) const {
  static const std::string none;
  const auto found = headers.find(lower_case_name);
  return found == headers.end() ? none : found->second;
}

HttpReply error_reply(int status, std::string_view code, const std::string& message) {
  const nlohmann::ordered_json body{{"error", {{"code", code}, {"message", message}}}};
  // A message may quote bytes of a client's file: what is not UTF-8 is replaced, never thrown at.
  return {status, json_text(body) + "\n", "application/json", {}};
}

HttpReply error_reply(const Error& error) {
  return error_reply(status_of(error.code), name_of(error.code), error.message);
}

}  // namespace lightrig
