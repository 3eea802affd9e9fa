#pragma once

#include <functional>
#include <nlohmann/json.hpp>
#include <string>
#include <string_view>

#include "cli/verbs.h"
#include "core/result.h"

namespace lightrig::cli {

/// A key that no other request has: one that is sent twice is then carried out once.
std::string request_key();

/// Where the API has a session. Errors: not_found for what can be no session's id.
Result<std::string> session_path(const std::string& id);

/// A call over the control socket (libcurl).
class ServiceClient {
 public:
  explicit ServiceClient(const ServiceOptions& options);

  /// The body of a GET. Errors: disconnected when no service answers (with what to do); the
  /// service's own refusals under their codes.
  Result<std::string> get(const std::string& path) const;
  Result<nlohmann::ordered_json> get_json(const std::string& path) const;
  Result<nlohmann::ordered_json> post(const std::string& path,
                                      const nlohmann::ordered_json& body) const;

  /// Reads server-sent events until `on_event` answers false or the service ends the stream.
  Result<void> events(
      const std::string& path,
      const std::function<bool(std::string_view event, const nlohmann::ordered_json& data)>&
          on_event) const;

  /// Waits for the end of a command: its message, or its failure.
  Result<std::string> wait_for(std::uint64_t command) const;

 private:
  std::string socket_, as_;
};

}  // namespace lightrig::cli
