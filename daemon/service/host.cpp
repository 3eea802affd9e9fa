#include "daemon/service/host.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/file.h>
#include <sys/random.h>
#include <sys/stat.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <cstring>
#include <utility>

#include "daemon/session/durable_file.h"

namespace lightrig {
namespace {

constexpr std::size_t worker_queue = 64;
constexpr int heartbeat_ticks = 15;
constexpr int disk_ticks = 5;
constexpr int device_ticks = 30;

// One service, one rig: the rig file is held for as long as this process lives, however it ends. In
// memory every service has a rig of its own.
Result<FileDescriptor> hold_rig(const std::filesystem::path& file) {
  FileDescriptor fd(::open(file.c_str(), O_RDONLY | O_CLOEXEC));
  if (fd.get() < 0)
    return fail(ErrorCode::refused, fmt::format("cannot read the rig file {}: {}", file.string(),
                                                std::strerror(errno)));
  if (flock(fd.get(), LOCK_EX | LOCK_NB) != 0)
    return fail(
        ErrorCode::refused,
        fmt::format("the rig of {} is in use by another lightrigd; stop it first: two hands "
                    "on one gantry collide",
                    file.string()));
  return fd;
}

Result<void> prepare_root(const std::filesystem::path& root) {
  std::error_code error;
  std::filesystem::create_directories(root, error);
  if (error)
    return fail(ErrorCode::refused,
                fmt::format("cannot make the session root {}: {}", root.string(), error.message()));
  if (access(root.c_str(), R_OK | W_OK | X_OK) != 0)
    return fail(ErrorCode::refused,
                fmt::format("the session root {} cannot be written: {}; give this user the right, "
                            "or choose another --session-root",
                            root.string(), std::strerror(errno)));
  return {};
}

}  // namespace

Result<std::string> token_of(const std::filesystem::path& file) {
  struct stat facts {};
  if (lstat(file.c_str(), &facts) != 0) {
    std::array<unsigned char, 32> random{};
    if (getrandom(random.data(), random.size(), 0) != static_cast<ssize_t>(random.size()))
      return fail(ErrorCode::refused, "the system gave no random numbers for a token");
    std::string token;
    for (unsigned char byte : random) token += fmt::format("{:02x}", byte);
    const FileDescriptor fd(
        ::open(file.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC | O_NOFOLLOW, 0600));
    const std::string line = token + "\n";
    if (fd.get() < 0 ||
        write(fd.get(), line.data(), line.size()) != static_cast<ssize_t>(line.size()))
      return fail(ErrorCode::refused, fmt::format("cannot make the token file {}: {}",
                                                  file.string(), std::strerror(errno)));
    return token;
  }
  if ((facts.st_mode & 077) != 0)
    return fail(ErrorCode::refused,
                fmt::format("others may read the token file {}: chmod 600 it", file.string()));
  auto text = read_file(file);
  if (!text) return tl::unexpected(with_context("read the token", text.error()));
  while (!text->empty() && (text->back() == '\n' || text->back() == ' ')) text->pop_back();
  if (text->size() < 16)
    return fail(ErrorCode::refused,
                fmt::format("the token in {} is shorter than 16 characters", file.string()));
  return *text;
}

Host::Host(Log& log)
    : log_(log),
      worker_(std::make_unique<Worker>(worker_queue)),
      looker_(std::make_unique<Worker>(1)) {}

Result<std::unique_ptr<Host>> Host::start(HostSettings settings, Log& log) {
  std::unique_ptr<Host> host(new Host(log));
  const std::filesystem::path root = settings.service.rig.session_root;
  if (auto ready = prepare_root(root); !ready) return tl::unexpected(ready.error());
  auto lock = LockFile::take(root / ".lightrigd.lock", "the session root " + root.string(),
                             "--session-root");
  if (!lock) return tl::unexpected(lock.error());
  host->root_lock_.emplace(std::move(*lock));
  if (!settings.service.simulate) {
    auto held = hold_rig(settings.service.rig.path);
    if (!held) return tl::unexpected(held.error());
    host->rig_lock_ = std::move(*held);
    auto claims = DeviceClaims::take(settings.service.rig);
    if (!claims) return tl::unexpected(claims.error());
    host->claims_ = std::move(*claims);
  }
  host->service_ = std::make_unique<Service>(settings.service, log, host->hub_, host->liveness_);
  if (auto open = host->open_sockets(settings); !open) return tl::unexpected(open.error());
  return host;
}

Host::~Host() {
  if (service_) service_->shut_down();
  // Streams end, then the replies being made; then nothing is suspended and the servers may go.
  hub_.close();
  worker_->stop();
  looker_->stop();
  servers_.clear();
}

Result<void> Host::open_sockets(const HostSettings& settings) {
  ActivatedSockets activated;
  if (settings.use_activated_sockets) activated = activated_sockets();
  if (activated.unix_sockets.empty()) {
    auto listener = UnixListener::open(settings.socket);
    if (!listener) return tl::unexpected(listener.error());
    // The server closes its copy; the listener keeps the file's name and lock until the end.
    FileDescriptor copy(fcntl(listener->fd(), F_DUPFD_CLOEXEC, 0));
    unix_listener_.emplace(std::move(*listener));
    if (auto served = serve(std::move(copy), false, settings); !served) return served;
    log_.info("listening", {{"socket", settings.socket.string()}});
  }
  for (FileDescriptor& fd : activated.unix_sockets) {
    if (auto served = serve(std::move(fd), false, settings); !served) return served;
    log_.info("listening", {{"socket", "handed in by systemd"}});
  }
  if (settings.listen) {
    auto fd = listen_tcp(*settings.listen);
    if (!fd) return tl::unexpected(fd.error());
    activated.tcp_sockets.push_back(std::move(*fd));
  }
  for (FileDescriptor& fd : activated.tcp_sockets) {
    if (auto ready = prepare_tcp(settings, fd.get()); !ready) return ready;
    if (auto served = serve(std::move(fd), true, settings); !served) return served;
    log_.info("listening", {{"tcp_port", std::to_string(tcp_port_)}});
  }
  return {};
}

Result<void> Host::prepare_tcp(const HostSettings& settings, int fd) {
  if (settings.token_file.empty())
    return fail(ErrorCode::invalid_input,
                "a TCP port needs a token: give --token-file FILE (it is made if absent)");
  auto token = token_of(settings.token_file);
  if (!token) return tl::unexpected(token.error());
  guard_.token = *token;
  tcp_port_ = bound_port(fd);
  for (std::string& host : hosts_of(fd, settings.hosts)) guard_.hosts.push_back(std::move(host));
  return {};
}

Result<void> Host::serve(FileDescriptor fd, bool tcp, const HostSettings& settings) {
  apis_.push_back(std::make_unique<Api>(*service_, hub_, log_, guard_));
  Api& api = *apis_.back();
  auto server = HttpServer::start(
      std::move(fd), tcp, [&api](const HttpRequest& request) { return api(request); },
      [&api](const HttpRequest& head) { return api.heed(head); }, hub_, *worker_, settings.limits);
  if (!server) return tl::unexpected(server.error());
  servers_.push_back(std::move(*server));
  return {};
}

void Host::tick() {
  for (const auto& server : servers_) server->drop_stalled();
  if (ticks_ % heartbeat_ticks == 0) hub_.heartbeat();
  // A hanging network disk holds the worker then, not whoever ticks.
  if (ticks_ % disk_ticks == 0) worker_->post([this] { service_->look_at_disk(); });
  if (ticks_ % device_ticks == 0) looker_->post([this] { service_->look_at_devices(); });
  ++ticks_;
}

}  // namespace lightrig
