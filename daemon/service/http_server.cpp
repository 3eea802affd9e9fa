#include <arpa/inet.h>
#include <fmt/format.h>
#include <microhttpd.h>
#include <netinet/in.h>
#include <sys/socket.h>

#include <algorithm>
#include <array>
#include <cctype>
#include <cstdlib>
#include <mutex>
#include <optional>

#include "daemon/service/http.h"

namespace lightrig {
namespace {

using SteadyClock = std::chrono::steady_clock;

std::string lower_case(std::string text) {
  for (char& c : text) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  return text;
}

MHD_Result collect_header(void* cls, MHD_ValueKind, const char* key, const char* value) {
  auto& headers = *static_cast<std::map<std::string, std::string>*>(cls);
  headers[lower_case(key)] = value == nullptr ? "" : value;
  return MHD_YES;
}

MHD_Result collect_query(void* cls, MHD_ValueKind, const char* key, const char* value) {
  auto& query = *static_cast<std::map<std::string, std::string>*>(cls);
  query[key] = value == nullptr ? "" : value;
  return MHD_YES;
}

std::string peer_of(int fd) {
  ucred who{};
  socklen_t size = sizeof who;
  sockaddr_storage address{};
  void* raw = &address;
  socklen_t address_size = sizeof address;
  if (getpeername(fd, static_cast<sockaddr*>(raw), &address_size) != 0) return "unknown";
  if (address.ss_family == AF_UNIX) {
    if (getsockopt(fd, SOL_SOCKET, SO_PEERCRED, &who, &size) != 0) return "unknown";
    return fmt::format("uid {} pid {}", who.uid, who.pid);
  }
  std::array<char, INET6_ADDRSTRLEN> text{};
  const void* ip = address.ss_family == AF_INET6
                       ? static_cast<const void*>(&static_cast<sockaddr_in6*>(raw)->sin6_addr)
                       : static_cast<const void*>(&static_cast<sockaddr_in*>(raw)->sin_addr);
  return inet_ntop(address.ss_family, ip, text.data(), text.size()) == nullptr ? "unknown"
                                                                               : text.data();
}

/// What is known of one connection, to choose whom to drop.
struct Connection {
  enum class Phase : std::uint8_t { waiting, answering, streaming, dropped };
  int fd = -1;
  Phase phase = Phase::waiting;
  SteadyClock::time_point since = SteadyClock::now();
};

/// One request on its way in and its answer on its way out.
struct Exchange {
  HttpRequest request;
  bool too_large = false;
  std::optional<HttpReply> later;  ///< made by the worker
};

/// A stream of events on its connection.
struct Stream {
  std::unique_ptr<EventHub::Reader> reader;
};

ssize_t read_stream(void* cls, std::uint64_t, char* buffer, std::size_t size) {
  const auto n = static_cast<Stream*>(cls)->reader->read({buffer, size});
  return n ? static_cast<ssize_t>(*n) : static_cast<ssize_t>(MHD_CONTENT_READER_END_OF_STREAM);
}

void free_stream(void* cls) { delete static_cast<Stream*>(cls); }

void ignore_log(void*, const char*, va_list) {}

}  // namespace

struct HttpServer::Impl {
  Impl(bool over_tcp, HttpHandler handle, HttpHead heed, EventHub& events, Worker& slow_worker,
       const HttpLimits& most)
      : tcp(over_tcp),
        handler(std::move(handle)),
        head(std::move(heed)),
        hub(events),
        worker(slow_worker),
        limits(most) {}

  bool tcp;
  HttpHandler handler;
  HttpHead head;
  EventHub& hub;
  Worker& worker;
  HttpLimits limits;
  MHD_Daemon* daemon = nullptr;
  mutable std::mutex mutex;
  std::map<MHD_Connection*, Connection> connections;

  void started(MHD_Connection* connection);
  void set_phase(MHD_Connection* connection, Connection::Phase phase);
  void make_room();
  MHD_Result on_request(MHD_Connection* connection, const char* url, const char* method,
                        const char* upload, std::size_t* upload_size, void** context);
  MHD_Result begin(MHD_Connection* connection, const char* url, const char* method, void** context);
  MHD_Result answer(MHD_Connection* connection, Exchange& exchange);
  HttpReply too_large() const;
  static MHD_Result send(MHD_Connection* connection, const HttpReply& reply);
  MHD_Result send_later(MHD_Connection* connection, Exchange& exchange, HttpLater later);
  MHD_Result send_events(MHD_Connection* connection, const HttpEvents& events);
};

void HttpServer::Impl::started(MHD_Connection* connection) {
  const MHD_ConnectionInfo* info =
      MHD_get_connection_info(connection, MHD_CONNECTION_INFO_CONNECTION_FD);
  const std::lock_guard lock(mutex);
  connections[connection].fd = info->connect_fd;
  if (connections.size() > static_cast<std::size_t>(limits.connections)) make_room();
}

// The longest idle goes first, then the oldest stream; a request being answered is never dropped.
void HttpServer::Impl::make_room() {
  for (const auto phase : {Connection::Phase::waiting, Connection::Phase::streaming}) {
    Connection* oldest = nullptr;
    for (auto& [unused, one] : connections)
      if (one.phase == phase && (oldest == nullptr || one.since < oldest->since)) oldest = &one;
    if (oldest == nullptr) continue;
    // The socket's thread notices and closes; the descriptor stays ours until then.
    shutdown(oldest->fd, SHUT_RDWR);
    oldest->phase = Connection::Phase::dropped;
    return;
  }
}

void HttpServer::Impl::set_phase(MHD_Connection* connection, Connection::Phase phase) {
  const std::lock_guard lock(mutex);
  const auto found = connections.find(connection);
  if (found == connections.end() || found->second.phase == Connection::Phase::dropped) return;
  found->second.phase = phase;
  found->second.since = SteadyClock::now();
}

MHD_Result HttpServer::Impl::begin(MHD_Connection* connection, const char* url, const char* method,
                                   void** context) {
  auto exchange = std::make_unique<Exchange>();
  HttpRequest& request = exchange->request;
  request.method = std::string_view(method) == MHD_HTTP_METHOD_HEAD ? MHD_HTTP_METHOD_GET : method;
  request.path = url;
  MHD_get_connection_values(connection, MHD_HEADER_KIND, &collect_header, &request.headers);
  MHD_get_connection_values(connection, MHD_GET_ARGUMENT_KIND, &collect_query, &request.query);
  request.over_tcp = tcp;
  request.peer =
      peer_of(MHD_get_connection_info(connection, MHD_CONNECTION_INFO_CONNECTION_FD)->connect_fd);
  request.acted = head(request);
  const std::string& length = request.header("content-length");
  const bool too_long =
      length.size() > 18 ||
      (!length.empty() && std::strtoull(length.c_str(), nullptr, 10) > limits.body_bytes);
  if (too_long && !request.acted) return send(connection, too_large());
  // What its head alone was enough for is answered by it alone. Nobody reads what follows: the
  // library closes the connection behind an answer that comes before its body.
  if (too_long) return answer(connection, *exchange);
  *context = exchange.release();
  return MHD_YES;
}

HttpReply HttpServer::Impl::too_large() const {
  return error_reply(413, "invalid_input",
                     fmt::format("the body may have {} bytes at most", limits.body_bytes));
}

// Called once with the headers, then with each piece of the body, then to answer; and once more
// after a reply that had to be waited for.
MHD_Result HttpServer::Impl::on_request(MHD_Connection* connection, const char* url,
                                        const char* method, const char* upload,
                                        std::size_t* upload_size, void** context) {
  if (*context == nullptr) return begin(connection, url, method, context);
  Exchange& exchange = *static_cast<Exchange*>(*context);
  if (*upload_size > 0) {
    if (exchange.request.body.size() + *upload_size > limits.body_bytes)
      exchange.too_large = true;
    else
      exchange.request.body.append(upload, *upload_size);
    *upload_size = 0;
    return MHD_YES;
  }
  return answer(connection, exchange);
}

MHD_Result HttpServer::Impl::answer(MHD_Connection* connection, Exchange& exchange) {
  if (exchange.later) return send(connection, *exchange.later);
  set_phase(connection, Connection::Phase::answering);
  if (exchange.too_large && exchange.request.acted) exchange.request.body.clear();
  if (exchange.too_large && !exchange.request.acted) return send(connection, too_large());
  HttpAnswer made = handler(exchange.request);
  if (auto* reply = std::get_if<HttpReply>(&made)) return send(connection, *reply);
  if (auto* later = std::get_if<HttpLater>(&made))
    return send_later(connection, exchange, std::move(*later));
  return send_events(connection, std::get<HttpEvents>(made));
}

MHD_Result HttpServer::Impl::send(MHD_Connection* connection, const HttpReply& reply) {
  std::string body = reply.body;
  MHD_Response* response =
      MHD_create_response_from_buffer(body.size(), body.data(), MHD_RESPMEM_MUST_COPY);
  if (response == nullptr) return MHD_NO;
  MHD_add_response_header(response, "Content-Type", reply.content_type.c_str());
  MHD_add_response_header(response, "Cache-Control", "no-store");
  MHD_add_response_header(response, "X-Content-Type-Options", "nosniff");
  for (const auto& [name, value] : reply.headers)
    MHD_add_response_header(response, name.c_str(), value.c_str());
  const MHD_Result result =
      MHD_queue_response(connection, static_cast<unsigned int>(reply.status), response);
  MHD_destroy_response(response);
  return result;
}

MHD_Result HttpServer::Impl::send_later(MHD_Connection* connection, Exchange& exchange,
                                        HttpLater later) {
  // Suspended first: until it is resumed the connection and its exchange cannot go away.
  MHD_suspend_connection(connection);
  const bool posted = worker.post([connection, &exchange, work = std::move(later.work)] {
    exchange.later = work();
    MHD_resume_connection(connection);
  });
  if (!posted) {
    exchange.later =
        error_reply(503, "refused", "too many requests at once; try again in a second");
    MHD_resume_connection(connection);
  }
  return MHD_YES;
}

MHD_Result HttpServer::Impl::send_events(MHD_Connection* connection, const HttpEvents& events) {
  if (hub.readers() >= static_cast<std::size_t>(limits.streams))
    return send(connection,
                error_reply(503, "refused",
                            fmt::format("{} readers of events are connected, the most there may be",
                                        limits.streams)));
  auto stream = std::make_unique<Stream>();
  stream->reader = hub.subscribe(
      events.session, events.after, [connection] { MHD_suspend_connection(connection); },
      [connection] { MHD_resume_connection(connection); });
  MHD_Response* response = MHD_create_response_from_callback(MHD_SIZE_UNKNOWN, 4096, &read_stream,
                                                             stream.get(), &free_stream);
  if (response == nullptr) return MHD_NO;
  (void)stream.release();  // the response's now
  MHD_add_response_header(response, "Content-Type", "text/event-stream");
  MHD_add_response_header(response, "Cache-Control", "no-store");
  MHD_add_response_header(response, "X-Content-Type-Options", "nosniff");
  MHD_set_connection_option(connection, MHD_CONNECTION_OPTION_TIMEOUT,
                            static_cast<unsigned int>(limits.stalled_stream.count()));
  set_phase(connection, Connection::Phase::streaming);
  const MHD_Result result = MHD_queue_response(connection, 200, response);
  MHD_destroy_response(response);
  return result;
}

namespace {

MHD_Result handle_request(void* cls, MHD_Connection* connection, const char* url,
                          const char* method, const char*, const char* upload,
                          std::size_t* upload_size, void** context) {
  return static_cast<HttpServer::Impl*>(cls)->on_request(connection, url, method, upload,
                                                         upload_size, context);
}

void handle_completed(void* cls, MHD_Connection* connection, void** context,
                      MHD_RequestTerminationCode) {
  delete static_cast<Exchange*>(*context);
  *context = nullptr;
  static_cast<HttpServer::Impl*>(cls)->set_phase(connection, Connection::Phase::waiting);
}

void handle_connection(void* cls, MHD_Connection* connection, void**,
                       MHD_ConnectionNotificationCode what) {
  auto& impl = *static_cast<HttpServer::Impl*>(cls);
  if (what == MHD_CONNECTION_NOTIFY_STARTED) {
    impl.started(connection);
    return;
  }
  // The descriptor is closed after this: from here on nobody may shut it down.
  const std::lock_guard lock(impl.mutex);
  impl.connections.erase(connection);
}

}  // namespace

Result<std::unique_ptr<HttpServer>> HttpServer::start(FileDescriptor listening, bool tcp,
                                                      HttpHandler handler, HttpHead head,
                                                      EventHub& hub, Worker& worker,
                                                      const HttpLimits& limits) {
  auto impl = std::make_unique<Impl>(tcp, std::move(handler), std::move(head), hub, worker, limits);
  const auto timeout = static_cast<unsigned int>(
      std::chrono::ceil<std::chrono::seconds>(limits.request).count() + 1);
  // Room above our own limit: a newcomer is accepted while the idlest is being closed.
  const auto most = static_cast<unsigned int>(limits.connections + 64);
  impl->daemon = MHD_start_daemon(
      MHD_USE_EPOLL_INTERNAL_THREAD | MHD_ALLOW_SUSPEND_RESUME, 0, nullptr, nullptr,
      &handle_request, impl.get(), MHD_OPTION_EXTERNAL_LOGGER, &ignore_log, nullptr,
      MHD_OPTION_LISTEN_SOCKET, listening.get(), MHD_OPTION_CONNECTION_LIMIT, most,
      MHD_OPTION_CONNECTION_TIMEOUT, timeout, MHD_OPTION_NOTIFY_COMPLETED, &handle_completed,
      impl.get(), MHD_OPTION_NOTIFY_CONNECTION, &handle_connection, impl.get(),
      MHD_OPTION_STRICT_FOR_CLIENT, 1, MHD_OPTION_END);
  if (impl->daemon == nullptr)
    return fail(ErrorCode::refused, "libmicrohttpd could not serve the listening socket");
  (void)listening.release();  // the daemon closes it
  return std::unique_ptr<HttpServer>(new HttpServer(std::move(impl)));
}

HttpServer::HttpServer(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}

HttpServer::~HttpServer() { MHD_stop_daemon(impl_->daemon); }

void HttpServer::drop_stalled() {
  const auto now = SteadyClock::now();
  const std::lock_guard lock(impl_->mutex);
  for (auto& [unused, one] : impl_->connections)
    if (one.phase == Connection::Phase::waiting && now - one.since > impl_->limits.request) {
      shutdown(one.fd, SHUT_RDWR);
      one.phase = Connection::Phase::dropped;
    }
}

std::size_t HttpServer::connections() const {
  const std::lock_guard lock(impl_->mutex);
  return impl_->connections.size();
}

}  // namespace lightrig
