#pragma once

#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "daemon/service/api.h"
#include "daemon/service/device_claims.h"
#include "daemon/service/http.h"
#include "daemon/service/service.h"

namespace lightrig {

struct HostSettings {
  ServiceSettings service;
  std::filesystem::path socket;      ///< Unix socket to make; unused where systemd hands one in
  std::optional<TcpAddress> listen;  ///< also serve TCP here
  std::vector<std::string> hosts;    ///< further names under which TCP clients may ask for us
  std::filesystem::path token_file;  ///< demanded with TCP; made where it does not exist
  HttpLimits limits;
  bool use_activated_sockets = true;
};

/// The service with its sockets: everything of lightrigd but the command line and the signals.
class Host {
 public:
  /// Errors: refused when the session root, the socket or a real rig is another service's, or not
  /// writable.
  static Result<std::unique_ptr<Host>> start(HostSettings settings, Log& log);
  ~Host();  ///< aborts what is under way, closes every connection
  Host(const Host&) = delete;
  Host& operator=(const Host&) = delete;

  /// What must be done about once a second: connections, heartbeats, disk, self-test.
  void tick();

  /// True while the session thread keeps its promise: then the watchdog may be fed.
  bool alive() const { return liveness_.holds(); }

  Service& service() { return *service_; }
  int tcp_port() const { return tcp_port_; }

 private:
  explicit Host(Log& log);
  Result<void> open_sockets(const HostSettings& settings);
  Result<void> serve(FileDescriptor fd, bool tcp, const HostSettings& settings);
  Result<void> prepare_tcp(const HostSettings& settings, int fd);

  Log& log_;
  Liveness liveness_;
  EventHub hub_;
  std::optional<LockFile> root_lock_;
  FileDescriptor rig_lock_;  ///< the rig file itself, where its devices are real …
  DeviceClaims claims_;      ///< … and these, which another file may name too
  std::unique_ptr<Service> service_;
  std::optional<UnixListener> unix_listener_;
  ApiGuard guard_;
  int tcp_port_ = 0;
  std::vector<std::unique_ptr<Api>> apis_;
  std::vector<std::unique_ptr<HttpServer>> servers_;
  std::unique_ptr<Worker> worker_;
  std::unique_ptr<Worker> looker_;  ///< of the self-test, which nobody's reply may wait for
  int ticks_ = 0;
};

/// The token of a file; the file is made, with a random token and mode 0600, where there is none.
/// Errors: refused when it cannot be read or made, or when others may read it.
Result<std::string> token_of(const std::filesystem::path& file);

}  // namespace lightrig
