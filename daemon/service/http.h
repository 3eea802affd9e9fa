#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <string>
#include <utility>
#include <variant>
#include <vector>

#include "core/result.h"
#include "daemon/service/event_hub.h"
#include "daemon/service/listeners.h"
#include "daemon/service/worker.h"

namespace lightrig {

struct HttpRequest {
  std::string method;                          ///< upper case; HEAD arrives as GET
  std::string path;                            ///< percent-decoded, without the query
  std::map<std::string, std::string> query;    ///< percent-decoded
  std::map<std::string, std::string> headers;  ///< names in lower case
  std::string body;
  bool over_tcp = false;
  bool acted = false;  ///< the head alone was enough (HttpHead): what it asks for is under way
  std::string peer;    ///< "uid 1000 pid 4711", or the TCP peer's address

  /// A header's value, or "".
  const std::string& header(const std::string& lower_case_name) const;
};

struct HttpReply {
  int status = 200;
  std::string body;
  std::string content_type = "application/json";
  std::vector<std::pair<std::string, std::string>> headers;
};
/// A reply that needs the disk: made on the worker while the socket's thread serves others.
struct HttpLater {
  std::function<HttpReply()> work;
};
/// A reply that never ends: the hub's events after this one.
struct HttpEvents {
  std::string session;
  std::uint64_t after = 0;
};
using HttpAnswer = std::variant<HttpReply, HttpLater, HttpEvents>;

/// Answers a request. Runs on the socket's one thread, so it must return at once: no disk, no
/// device, no waiting.
using HttpHandler = std::function<HttpAnswer(const HttpRequest&)>;

/// Told of a request once its head is there and before any of its body is: true where it has acted
/// on that already. The handler is asked all the same, for the answer; of such a request no body is
/// refused; one that is too large is not kept, and one that says so is not waited for. Runs where
/// the handler does.
using HttpHead = std::function<bool(const HttpRequest&)>;

struct HttpLimits {
  int connections = 64;  ///< above this the one that has asked for nothing the longest is dropped
  int streams = 16;      ///< readers of events, over all sockets
  std::size_t body_bytes = std::size_t{4} << 20;
  std::chrono::milliseconds request{10000};  ///< for a whole request to arrive, or the next one
  std::chrono::seconds stalled_stream{60};   ///< a reader that takes nothing for so long is dropped
};

/// An HTTP/1.1 server on one listening socket (libmicrohttpd, epoll, one thread). Every connection
/// is served as its bytes arrive, none is waited for; when there are too many, the idlest gives way
/// to the newest, so that there is always room for an ABORT.
class HttpServer {
 public:
  /// `hub` and `worker` must outlive the server, and must be closed and stopped before it is
  /// destroyed. Errors: refused.
  static Result<std::unique_ptr<HttpServer>> start(FileDescriptor listening, bool tcp,
                                                   HttpHandler handler, HttpHead head,
                                                   EventHub& hub, Worker& worker,
                                                   const HttpLimits& limits);
  ~HttpServer();
  HttpServer(const HttpServer&) = delete;
  HttpServer& operator=(const HttpServer&) = delete;

  /// Drops connections whose request has not arrived in time; to be called about once a second.
  void drop_stalled();

  std::size_t connections() const;

  struct Impl;  ///< libmicrohttpd's side, in http_server.cpp

 private:
  explicit HttpServer(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

/// {"error":{"code":…,"message":…}} with the status that fits the code.
HttpReply error_reply(const Error& error);
HttpReply error_reply(int status, std::string_view code, const std::string& message);

}  // namespace lightrig
