#include "cli/service_client.h"

#include <curl/curl.h>
#include <fmt/format.h>
#include <sys/random.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <memory>
#include <thread>
#include <utility>

#include "cli/json_fields.h"
#include "config/json_text.h"
#include "daemon/session/json_parse.h"

namespace lightrig::cli {
namespace {

struct Reply {
  long status = 0;
  std::string body;
};

/// Cuts a stream of server-sent events into events.
struct EventCutter {
  std::function<bool(std::string_view, const Json&)> on_event;
  std::string buffer;
  bool go_on = true;

  void feed(std::string_view bytes) {
    buffer += bytes;
    for (auto end = buffer.find("\n\n"); end != std::string::npos && go_on;
         end = buffer.find("\n\n")) {
      take(std::string_view(buffer).substr(0, end));
      buffer.erase(0, end + 2);
    }
  }
  void take(std::string_view block) {
    std::string_view event, data;
    while (!block.empty()) {
      const auto end = block.find('\n');
      const std::string_view line = block.substr(0, end);
      block = end == block.npos ? std::string_view() : block.substr(end + 1);
      if (line.starts_with("event: ")) event = line.substr(7);
      if (line.starts_with("data: ")) data = line.substr(6);
    }
    if (data.empty()) return;  // a heartbeat
    if (const auto json = parse_json(data)) go_on = on_event(event, *json);
  }
};

std::size_t append_body(char* data, std::size_t, std::size_t size, void* target) {
  static_cast<std::string*>(target)->append(data, size);
  return size;
}

std::size_t cut_events(char* data, std::size_t, std::size_t size, void* target) {
  auto& cutter = *static_cast<EventCutter*>(target);
  cutter.feed({data, size});
  return cutter.go_on ? size : 0;  // anything but `size` ends the transfer
}

/// One libcurl transfer, cleaned up at its end.
class Transfer {
 public:
  Transfer(const std::string& socket, const std::string& as, const std::string& path)
      : curl_(curl_easy_init(), &curl_easy_cleanup), headers_(nullptr, &curl_slist_free_all) {
    curl_easy_setopt(curl_.get(), CURLOPT_UNIX_SOCKET_PATH, socket.c_str());
    curl_easy_setopt(curl_.get(), CURLOPT_URL, ("http://localhost" + path).c_str());
    curl_easy_setopt(curl_.get(), CURLOPT_NOSIGNAL, 1L);
    curl_easy_setopt(curl_.get(), CURLOPT_CONNECTTIMEOUT, 5L);
    add_header("X-Lightrig: 1");
    add_header("Content-Type: application/json");
    if (!as.empty()) add_header("X-Lightrig-Client: " + as);
  }
  void post(const std::string& body) {
    body_ = body;
    curl_easy_setopt(curl_.get(), CURLOPT_POST, 1L);
    curl_easy_setopt(curl_.get(), CURLOPT_POSTFIELDS, body_.c_str());
    curl_easy_setopt(curl_.get(), CURLOPT_POSTFIELDSIZE, static_cast<long>(body_.size()));
  }
  void deliver_to(std::size_t (*write)(char*, std::size_t, std::size_t, void*), void* target) {
    curl_easy_setopt(curl_.get(), CURLOPT_WRITEFUNCTION, write);
    curl_easy_setopt(curl_.get(), CURLOPT_WRITEDATA, target);
  }
  void give_up_after(long seconds) { curl_easy_setopt(curl_.get(), CURLOPT_TIMEOUT, seconds); }
  CURLcode run() {
    curl_easy_setopt(curl_.get(), CURLOPT_HTTPHEADER, headers_.get());
    return curl_easy_perform(curl_.get());
  }
  long status() const {
    long status = 0;
    curl_easy_getinfo(curl_.get(), CURLINFO_RESPONSE_CODE, &status);
    return status;
  }

 private:
  void add_header(const std::string& line) {
    headers_.reset(curl_slist_append(headers_.release(), line.c_str()));
  }
  std::unique_ptr<CURL, decltype(&curl_easy_cleanup)> curl_;
  std::unique_ptr<curl_slist, decltype(&curl_slist_free_all)> headers_;
  std::string body_;
};

tl::unexpected<Error> unreachable(const std::string& socket, CURLcode code) {
  return fail(ErrorCode::disconnected,
              fmt::format("no lightrigd answers on {} ({}); is the service running, and does its "
                          "--socket agree with --socket or $LIGHTRIG_SOCKET here?",
                          socket, curl_easy_strerror(code)));
}

ErrorCode code_named(const std::string& name) {
  for (ErrorCode code : {ErrorCode::invalid_input, ErrorCode::not_built, ErrorCode::not_found,
                         ErrorCode::disconnected, ErrorCode::timed_out, ErrorCode::refused,
                         ErrorCode::stopped, ErrorCode::no_space})
    if (name == name_of(code)) return code;
  return ErrorCode::refused;
}

// The service's own words where it refuses.
Result<std::string> body_of(const Reply& reply) {
  if (reply.status >= 200 && reply.status < 300) return reply.body;
  const auto json = parse_json(reply.body);
  const Json& error = json ? part(*json, "error") : Json();
  if (error.is_object()) return fail(code_named(text(error, "code")), text(error, "message"));
  return fail(ErrorCode::refused, fmt::format("the service answered {}", reply.status));
}

Result<std::string> call(Transfer& transfer, const std::string& socket) {
  Reply reply;
  transfer.deliver_to(&append_body, &reply.body);
  transfer.give_up_after(60);
  const CURLcode code = transfer.run();
  if (code != CURLE_OK) return unreachable(socket, code);
  reply.status = transfer.status();
  return body_of(reply);
}

Result<Json> parsed(const Result<std::string>& body) {
  if (!body) return tl::unexpected(body.error());
  auto json = parse_json(*body);
  if (!json) return fail(ErrorCode::refused, "read the service's answer: " + json.error().message);
  return json;
}

}  // namespace

std::string request_key() {
  std::array<unsigned char, 12> random{};
  if (getrandom(random.data(), random.size(), 0) != static_cast<ssize_t>(random.size())) return {};
  std::string key;
  for (const unsigned char byte : random) key += fmt::format("{:02x}", byte);
  return key;
}

Result<std::string> session_path(const std::string& id) {
  const bool plain = std::ranges::all_of(id, [](char c) {
    return (c >= '0' && c <= '9') || (c >= 'A' && c <= 'Z') || (c >= 'a' && c <= 'z') || c == '.' ||
           c == '_' || c == '-';
  });
  // In a path it would mean another operation, or none.
  if (!plain || id.empty())
    return fail(ErrorCode::not_found,
                fmt::format("there is no session \"{}\"; lightrig sessions lists them", id));
  return "/v1/sessions/" + id;
}

ServiceClient::ServiceClient(const ServiceOptions& options)
    : socket_(options.socket), as_(options.as) {}

Result<std::string> ServiceClient::get(const std::string& path) const {
  Transfer transfer(socket_, as_, path);
  return call(transfer, socket_);
}

Result<Json> ServiceClient::get_json(const std::string& path) const { return parsed(get(path)); }

Result<Json> ServiceClient::post(const std::string& path, const Json& body) const {
  Transfer transfer(socket_, as_, path);
  transfer.post(json_text(body));
  return parsed(call(transfer, socket_));
}

Result<void> ServiceClient::events(
    const std::string& path,
    const std::function<bool(std::string_view, const Json&)>& on_event) const {
  Transfer transfer(socket_, as_, path);
  EventCutter cutter{on_event, {}, true};
  transfer.deliver_to(&cut_events, &cutter);
  const CURLcode code = transfer.run();
  if (!cutter.go_on) return {};
  // A stream that had begun is cut by the end of the service, not by a wrong socket.
  if (code != CURLE_OK && transfer.status() == 0) return unreachable(socket_, code);
  if (code == CURLE_OK && transfer.status() != 200)
    return fail(ErrorCode::refused,
                fmt::format("the service answered {} to {}", transfer.status(), path));
  return fail(ErrorCode::disconnected, "the service ended: it was stopped, or has failed");
}

Result<std::string> ServiceClient::wait_for(std::uint64_t command) const {
  using namespace std::chrono_literals;
  bool known = true;
  while (known) {
    const auto status = get_json("/v1/status");
    if (!status) return tl::unexpected(status.error());
    known = false;
    for (const Json& one : status->value("commands", Json::array())) {
      if (one.value("id", std::uint64_t{0}) != command) continue;
      known = true;
      const std::string state = one.value("state", "");
      if (state == "done") return one.value("message", "");
      if (state == "failed") return fail(ErrorCode::refused, one.value("message", ""));
    }
    if (known) std::this_thread::sleep_for(50ms);
  }
  // Records are kept for a while only, and not over a restart.
  return fail(ErrorCode::not_found,
              fmt::format("the service no longer knows command {}: it was restarted, or much was "
                          "asked of it since; see lightrig status",
                          command));
}

}  // namespace lightrig::cli
