#include "daemon/service/api.h"

#include <fmt/format.h>

#include <algorithm>
#include <string_view>
#include <utility>

#include "core/check.h"

namespace lightrig {
namespace {

// Equal without telling by its time where the first difference stands.
bool equal_in_constant_time(std::string_view a, std::string_view b) {
  if (a.size() != b.size()) return false;
  unsigned char difference = 0;
  for (std::size_t i = 0; i < a.size(); ++i)
    difference = static_cast<unsigned char>(difference | (a[i] ^ b[i]));
  return difference == 0;
}

std::string lower_case(std::string text) {
  for (char& c : text)
    if (c >= 'A' && c <= 'Z') c = static_cast<char>(c - 'A' + 'a');
  return text;
}

// "http://host:port" of an Origin header; "" when it is none of http.
std::string host_of_origin(const std::string& origin) {
  for (std::string_view scheme : {"http://", "https://"})
    if (origin.starts_with(scheme)) return origin.substr(scheme.size());
  return {};
}

// The {id} of a template, or empty when the path does not fit it.
std::optional<std::string> match(std::string_view pattern, std::string_view path) {
  const auto open = pattern.find('{');
  if (open == pattern.npos) return pattern == path ? std::optional<std::string>("") : std::nullopt;
  const std::string_view tail = pattern.substr(pattern.find('}') + 1);
  if (!path.starts_with(pattern.substr(0, open)) || !path.ends_with(tail) ||
      path.size() <= open + tail.size())
    return {};
  const std::string_view id = path.substr(open, path.size() - open - tail.size());
  if (id.find('/') != id.npos) return {};
  return std::string(id);
}

bool is_mutation(const Route& route) {
  return route.kind == Route::Kind::mutation || route.kind == Route::Kind::unlocked;
}

}  // namespace

Caller caller_of(const HttpRequest& request) {
  Caller caller{request.header("x-lightrig-client"), request.peer};
  if (caller.name.empty()) caller.name = request.over_tcp ? "panel" : request.peer;
  return caller;
}

Result<std::filesystem::path> session_folder_of(const std::filesystem::path& root,
                                                const std::string& id) {
  const bool plain = !id.empty() && id.size() <= 200 && id.front() != '.' &&
                     std::all_of(id.begin(), id.end(), [](char c) {
                       return (c >= '0' && c <= '9') || (c >= 'A' && c <= 'Z') ||
                              (c >= 'a' && c <= 'z') || c == '.' || c == '_' || c == '-';
                     });
  std::error_code error;
  const std::filesystem::path folder = root / (plain ? id : "");
  // A link could lead anywhere: only a real folder counts.
  if (!plain || std::filesystem::symlink_status(folder, error).type() !=
                    std::filesystem::file_type::directory)
    return fail(ErrorCode::not_found,
                fmt::format("there is no session \"{}\"; lightrig sessions lists them", id));
  return folder;
}

Api::Api(Service& service, EventHub& hub, Log& log, ApiGuard guard)
    : service_(service), hub_(hub), log_(log), guard_(std::move(guard)) {}

HttpAnswer Api::operator()(const HttpRequest& request) {
  HttpAnswer answer = dispatch(request);
  if (const auto* reply = std::get_if<HttpReply>(&answer); reply != nullptr && reply->status >= 400)
    log_.debug("refused_request", {{"method", request.method},
                                   {"path", request.path},
                                   {"status", std::to_string(reply->status)},
                                   {"peer", request.peer}});
  return answer;
}

bool Api::heed(const HttpRequest& head) {
  for (const Route& route : routes()) {
    if (!is_abort(route) || head.method != route.method || !match(route.path, head.path)) continue;
    if (refuse(head, route)) return false;
    const Caller caller = caller_of(head);
    service_.abort(caller, aborted_by(caller));
    return true;
  }
  return false;
}

std::string Api::aborted_by(const Caller& caller) { return "aborted by " + caller.name; }

bool Api::is_abort(const Route& route) {
  return route.handle == &Api::abort || route.handle == &Api::abort_session;
}

HttpAnswer Api::dispatch(const HttpRequest& request) {
  std::string allowed;
  for (const Route& route : routes()) {
    const auto id = match(route.path, request.path);
    if (!id) continue;
    if (request.method != route.method) {
      allowed += (allowed.empty() ? "" : ", ") + std::string(route.method);
      continue;
    }
    if (auto refusal = refuse(request, route)) return *refusal;
    // An ABORT is one whatever its body holds.
    const bool aborts = is_abort(route);
    if (route.large) return read_later(request, route, *id);
    if (request.body.size() > small_body && !aborts)
      return error_reply(413, "invalid_input",
                         fmt::format("the body may have {} bytes at most here", small_body));
    if (is_mutation(route) && !aborts)
      if (auto checked = check_body(request.body, route.body); !checked)
        return error_reply(checked.error());
    return (this->*route.handle)(request, *id);
  }
  if (allowed.empty())
    return error_reply(
        404, "not_found",
        fmt::format("there is no {}; GET /v1/openapi.json lists what there is", request.path));
  HttpReply reply =
      error_reply(405, "invalid_input", fmt::format("{} takes {}", request.path, allowed));
  reply.headers.emplace_back("Allow", allowed);
  return reply;
}

HttpAnswer Api::read_later(const HttpRequest& request, const Route& route, const std::string& id) {
  return HttpLater{[this, request, &route, id]() -> HttpReply {
    if (auto checked = check_body(request.body, route.body); !checked)
      return error_reply(checked.error());
    HttpAnswer answer = (this->*route.handle)(request, id);
    CHECK(std::holds_alternative<HttpReply>(answer));
    return std::get<HttpReply>(std::move(answer));
  }};
}

// In the order in which an attack would fail first: who may speak to us at all, then who may move
// the rig, then what they say.
std::optional<HttpReply> Api::refuse(const HttpRequest& request, const Route& route) const {
  if (request.over_tcp) {
    const std::string host = lower_case(request.header("host"));
    // Against DNS rebinding: a page of another name must not reach us through the browser.
    if (std::find(guard_.hosts.begin(), guard_.hosts.end(), host) == guard_.hosts.end())
      return error_reply(421, "refused",
                         "this Host is not served here; use the address that the "
                         "service listens on, or start it with --host for another name");
    const std::string& origin = request.header("origin");
    if (!origin.empty() && host_of_origin(lower_case(origin)) != host)
      return error_reply(403, "refused", "requests from other web sites are refused");
    if (route.kind != Route::Kind::page &&
        (guard_.token.empty() ||
         !equal_in_constant_time(request.header("authorization"), "Bearer " + guard_.token))) {
      HttpReply reply = error_reply(401, "refused",
                                    "a token is needed: Authorization: Bearer …, from the file "
                                    "given by --token-file");
      reply.headers.emplace_back("WWW-Authenticate", "Bearer");
      return reply;
    }
  } else if (!request.header("origin").empty()) {
    return error_reply(403, "refused", "browsers have no business on the Unix socket");
  }
  if (!is_mutation(route)) return {};
  // A form or an image tag of a web page cannot set these two.
  if (request.header("x-lightrig") != "1")
    return error_reply(403, "refused",
                       "requests that change something need the header "
                       "X-Lightrig: 1");
  const std::string type = lower_case(request.header("content-type"));
  if (type != "application/json" && !type.starts_with("application/json;"))
    return error_reply(415, "invalid_input",
                       "requests that change something need Content-Type: application/json");
  if (route.kind == Route::Kind::mutation)
    if (auto may = service_.may_command(caller_of(request)); !may)
      return error_reply(423, name_of(may.error().code), may.error().message);
  return {};
}

}  // namespace lightrig
