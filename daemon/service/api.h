#pragma once

#include <functional>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "daemon/service/api_body.h"
#include "daemon/service/http.h"
#include "daemon/service/service.h"

namespace lightrig {

/// What the API demands of a request before anything is asked of the service.
struct ApiGuard {
  std::string token;               ///< demanded over TCP; "" only where there is no TCP
  std::vector<std::string> hosts;  ///< Host values that are answered, lower case
};

class Api;

/// What a body may have at most, save a plan's: it is read on the socket's thread, where an ABORT
/// may be the next to come.
inline constexpr std::size_t small_body = std::size_t{64} << 10;
/// Of an ABORT's body, beyond which its reason is not read.
inline constexpr std::size_t abort_body = std::size_t{4} << 10;

/// One operation: the handlers and the OpenAPI document are made from the same table.
struct Route {
  const char* method;
  const char* path;  ///< with {id} where a name stands
  const char* summary;
  enum class Kind : std::uint8_t {
    page,      ///< the panel's files: no token, TCP only
    read,      ///< changes nothing
    mutation,  ///< JSON content type and X-Lightrig header demanded; respects the lock
    unlocked,  ///< a mutation that the lock does not hold back
  } kind;
  std::vector<BodyField> body;
  HttpAnswer (Api::*handle)(const HttpRequest& request, const std::string& id);
  /// The body may have HttpLimits::body_bytes instead of small_body; it is read, and answered, on
  /// the worker.
  bool large = false;
};

/// Control API, version 1 [docs/control_api.md]: from requests to the service's calls.
class Api {
 public:
  Api(Service& service, EventHub& hub, Log& log, ApiGuard guard);

  /// Answers one request; never waits, never throws.
  HttpAnswer operator()(const HttpRequest& request);

  /// Acts on a request whose body has not come yet: on an ABORT that nothing else is the matter
  /// with, and on nothing else. True where it did.
  bool heed(const HttpRequest& head);

  static std::span<const Route> routes();

 private:
  // api_routes.cpp: the parts of routes()
  static std::vector<Route> rig_routes();
  static std::vector<Route> session_routes();
  static std::vector<Route> service_routes();

  HttpAnswer dispatch(const HttpRequest& request);
  static bool is_abort(const Route& route);
  static std::string aborted_by(const Caller& caller);
  std::optional<HttpReply> refuse(const HttpRequest& request, const Route& route) const;
  HttpAnswer read_later(const HttpRequest& request, const Route& route, const std::string& id);

  HttpAnswer status(const HttpRequest&, const std::string&);
  HttpAnswer arm(const HttpRequest&, const std::string&);
  HttpAnswer disarm(const HttpRequest&, const std::string&);
  HttpAnswer clear(const HttpRequest&, const std::string&);
  HttpAnswer home(const HttpRequest&, const std::string&);
  HttpAnswer jog(const HttpRequest&, const std::string&);
  HttpAnswer lamp(const HttpRequest&, const std::string&);
  HttpAnswer snap(const HttpRequest&, const std::string&);
  HttpAnswer rig(const HttpRequest&, const std::string&);
  HttpAnswer abort(const HttpRequest&, const std::string&);
  HttpAnswer lock(const HttpRequest&, const std::string&);
  HttpAnswer unlock(const HttpRequest&, const std::string&);
  HttpAnswer list_sessions(const HttpRequest&, const std::string&);
  HttpAnswer start(const HttpRequest&, const std::string&);
  HttpAnswer session(const HttpRequest&, const std::string&);
  HttpAnswer session_plan(const HttpRequest&, const std::string&);
  HttpAnswer session_result(const HttpRequest&, const std::string&);
  HttpAnswer pause(const HttpRequest&, const std::string&);
  HttpAnswer resume(const HttpRequest&, const std::string&);
  HttpAnswer stop(const HttpRequest&, const std::string&);
  HttpAnswer halt(const HttpRequest&, const std::string&);
  HttpAnswer retake(const HttpRequest&, const std::string&);
  void tell_retake(const std::string& id, const SessionFolder& folder);
  HttpAnswer abort_session(const HttpRequest&, const std::string&);
  HttpAnswer events(const HttpRequest&, const std::string&);
  HttpAnswer preview(const HttpRequest&, const std::string&);
  HttpAnswer recent_log(const HttpRequest&, const std::string&);
  HttpAnswer log_level(const HttpRequest&, const std::string&);
  HttpAnswer metrics(const HttpRequest&, const std::string&);
  HttpAnswer openapi(const HttpRequest&, const std::string&);
  HttpAnswer page(const HttpRequest&, const std::string&);

  HttpAnswer steer(const HttpRequest& request, const std::string& id, SessionVerb verb);

  Service& service_;
  EventHub& hub_;
  Log& log_;
  const ApiGuard guard_;
};

/// Who a request says it is (X-Lightrig-Client), and where it came from.
Caller caller_of(const HttpRequest& request);

/// The folder of a session named in a request. Errors: not_found for anything that is not a plain
/// name of a real folder right below the root (no traversal, no symbolic link).
Result<std::filesystem::path> session_folder_of(const std::filesystem::path& root,
                                                const std::string& id);

/// The OpenAPI 3.1 document of the routes.
std::string openapi_document();

/// The operator panel's page; `not_built` where the build leaves it out.
Result<std::string> panel_page();

}  // namespace lightrig
