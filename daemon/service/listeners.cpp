#include "daemon/service/listeners.h"

#include <arpa/inet.h>
#include <fcntl.h>
#include <fmt/format.h>
#include <grp.h>
#include <ifaddrs.h>
#include <netdb.h>
#include <sys/file.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <systemd/sd-daemon.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <charconv>
#include <cstring>
#include <memory>
#include <utility>

namespace lightrig {
namespace {

std::string reason() { return std::strerror(errno); }

// sockaddr_un and its kin are handed to the kernel as the general sockaddr: the one cast there is.
const sockaddr* as_sockaddr(const void* address) { return static_cast<const sockaddr*>(address); }

sockaddr_un unix_address(const std::filesystem::path& path) {
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  path.string().copy(address.sun_path, sizeof(address.sun_path) - 1);
  return address;
}

bool someone_answers(const sockaddr_un& address) {
  FileDescriptor probe(socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0));
  if (connect(probe.get(), as_sockaddr(&address), sizeof address) == 0) return true;
  return errno == EAGAIN || errno == EINPROGRESS;  // its backlog is full: alive, if busy
}

void give_to_group(const std::filesystem::path& path) {
  const group* lightrig = getgrnam("lightrig");
  // Without the group, or the right to give files to it, the socket stays with our own group.
  if (lightrig != nullptr && lchown(path.c_str(), static_cast<uid_t>(-1), lightrig->gr_gid) != 0)
    return;
}

// The way is free, or was freed of a socket left behind.
Result<void> clear_the_way(const std::filesystem::path& path, const sockaddr_un& address) {
  struct stat facts {};
  if (lstat(path.c_str(), &facts) != 0) return {};
  if (!S_ISSOCK(facts.st_mode))
    return fail(ErrorCode::refused, fmt::format("{} is there already and is not a socket; remove "
                                                "it or choose another --socket",
                                                path.string()));
  if (someone_answers(address))
    return fail(ErrorCode::refused,
                fmt::format("another lightrigd answers on {}; stop it, or choose another --socket",
                            path.string()));
  if (unlink(path.c_str()) != 0)
    return fail(ErrorCode::refused,
                fmt::format("cannot remove the stale socket {}: {}", path.string(), reason()));
  return {};
}

}  // namespace

Result<LockFile> LockFile::take(const std::filesystem::path& path, const std::string& what,
                                const std::string& option) {
  LockFile lock;
  lock.fd_ = FileDescriptor(::open(path.c_str(), O_RDWR | O_CREAT | O_CLOEXEC | O_NOFOLLOW, 0640));
  if (lock.fd_.get() < 0)
    return fail(ErrorCode::refused,
                fmt::format("cannot make the lock file {}: {}; give this user the right to write "
                            "there{}{}",
                            path.string(), reason(),
                            option.empty() ? "" : ", or choose another place with ", option));
  if (flock(lock.fd_.get(), LOCK_EX | LOCK_NB) != 0) {
    std::array<char, 32> holder{};
    const ssize_t n = pread(lock.fd_.get(), holder.data(), holder.size() - 1, 0);
    std::string who(holder.data(), n > 0 ? static_cast<std::size_t>(n) : 0);
    while (!who.empty() && who.back() == '\n') who.pop_back();
    return fail(ErrorCode::refused,
                fmt::format("{} is in use by another lightrigd{} (lock file {}); stop it first",
                            what, who.empty() ? "" : " (process " + who + ")", path.string()));
  }
  const std::string id = fmt::format("{}\n", getpid());
  // The number only helps a person find the holder; the lock itself does not depend on it.
  if (ftruncate(lock.fd_.get(), 0) == 0) (void)!pwrite(lock.fd_.get(), id.data(), id.size(), 0);
  return lock;
}

Result<UnixListener> UnixListener::open(const std::filesystem::path& path) {
  const sockaddr_un address = unix_address(path);
  if (path.string().size() >= sizeof(address.sun_path))
    return fail(ErrorCode::refused,
                fmt::format("the socket path is {} bytes long, a Unix socket's may have {}: {}",
                            path.string().size(), sizeof(address.sun_path) - 1, path.string()));
  // The lock closes the gap between asking who answers and taking the place.
  auto lock = LockFile::take(path.string() + ".lock", "the control socket " + path.string(),
                             "--socket or $LIGHTRIG_SOCKET");
  if (!lock) return tl::unexpected(lock.error());
  if (auto clear = clear_the_way(path, address); !clear) return tl::unexpected(clear.error());

  UnixListener listener;
  listener.lock_ = std::move(*lock);
  listener.fd_ = FileDescriptor(socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0));
  // Strictest first: nobody may connect between bind and chmod.
  const mode_t before = umask(0177);
  const int bound = bind(listener.fd_.get(), as_sockaddr(&address), sizeof address);
  const int bind_errno = errno;
  umask(before);
  if (bound != 0)
    return fail(ErrorCode::refused, fmt::format("cannot make the control socket {}: {}",
                                                path.string(), std::strerror(bind_errno)));
  give_to_group(path);
  struct stat facts {};
  if (chmod(path.c_str(), 0660) != 0 || listen(listener.fd_.get(), 128) != 0 ||
      lstat(path.c_str(), &facts) != 0)
    return fail(ErrorCode::refused,
                fmt::format("cannot open the control socket {}: {}", path.string(), reason()));
  listener.path_ = path;
  listener.inode_ = facts.st_ino;
  return listener;
}

UnixListener::~UnixListener() {
  struct stat facts {};
  if (fd_.get() >= 0 && !path_.empty() && lstat(path_.c_str(), &facts) == 0 &&
      facts.st_ino == inode_)
    unlink(path_.c_str());
}

Result<TcpAddress> parse_tcp_address(const std::string& text) {
  const auto colon = text.rfind(':');
  TcpAddress address;
  bool good = colon != std::string::npos;
  if (good) {
    const char* end = text.data() + text.size();
    const auto [last, error] = std::from_chars(text.data() + colon + 1, end, address.port);
    good = error == std::errc() && last == end && address.port >= 0 && address.port <= 65535;
    address.host = text.substr(0, colon);
  }
  if (address.host.size() > 2 && address.host.front() == '[' && address.host.back() == ']')
    address.host = address.host.substr(1, address.host.size() - 2);
  if (address.host.empty()) address.host = "127.0.0.1";
  in_addr v4{};
  in6_addr v6{};
  const bool is_v4 = inet_pton(AF_INET, address.host.c_str(), &v4) == 1;
  const bool is_v6 = inet_pton(AF_INET6, address.host.c_str(), &v6) == 1;
  if (!good || (!is_v4 && !is_v6))
    return fail(ErrorCode::invalid_input,
                fmt::format("\"{}\" is no address to listen on: give a numeric host and a port, as "
                            "in 127.0.0.1:8080 or [::1]:8080",
                            text));
  address.loopback = is_v4 ? (ntohl(v4.s_addr) >> 24) == 127 : IN6_IS_ADDR_LOOPBACK(&v6) != 0;
  return address;
}

Result<FileDescriptor> listen_tcp(const TcpAddress& address) {
  addrinfo hints{};
  hints.ai_socktype = SOCK_STREAM;
  hints.ai_flags = AI_NUMERICHOST | AI_NUMERICSERV | AI_PASSIVE;
  addrinfo* found = nullptr;
  const int error =
      getaddrinfo(address.host.c_str(), std::to_string(address.port).c_str(), &hints, &found);
  if (error != 0)
    return fail(ErrorCode::refused, fmt::format("cannot listen on {}:{}: {}", address.host,
                                                address.port, gai_strerror(error)));
  const std::unique_ptr<addrinfo, decltype(&freeaddrinfo)> owner(found, &freeaddrinfo);
  FileDescriptor fd(socket(found->ai_family, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0));
  const int yes = 1;
  setsockopt(fd.get(), SOL_SOCKET, SO_REUSEADDR, &yes, sizeof yes);
  if (bind(fd.get(), found->ai_addr, found->ai_addrlen) != 0 || listen(fd.get(), 128) != 0)
    return fail(ErrorCode::refused, fmt::format("cannot listen on {}:{}: {}; choose another port",
                                                address.host, address.port, reason()));
  return fd;
}

int bound_port(int fd) {
  sockaddr_storage address{};
  socklen_t size = sizeof address;
  void* raw = &address;
  if (getsockname(fd, static_cast<sockaddr*>(raw), &size) != 0) return 0;
  if (address.ss_family == AF_INET6) return ntohs(static_cast<sockaddr_in6*>(raw)->sin6_port);
  return address.ss_family == AF_INET ? ntohs(static_cast<sockaddr_in*>(raw)->sin_port) : 0;
}

namespace {

// As it stands in a URL; "" for what is neither, and for a wildcard.
std::string url_host(const sockaddr& address) {
  std::array<char, INET6_ADDRSTRLEN> text{};
  const void* raw = &address;
  if (address.sa_family == AF_INET) {
    const auto& ip = static_cast<const sockaddr_in*>(raw)->sin_addr;
    if (ip.s_addr == htonl(INADDR_ANY) || !inet_ntop(AF_INET, &ip, text.data(), text.size()))
      return {};
    return text.data();
  }
  if (address.sa_family != AF_INET6) return {};
  const auto& ip = static_cast<const sockaddr_in6*>(raw)->sin6_addr;
  if (IN6_IS_ADDR_UNSPECIFIED(&ip) || !inet_ntop(AF_INET6, &ip, text.data(), text.size()))
    return {};
  return fmt::format("[{}]", text.data());
}

// Every address of this machine that a wildcard of this family answers at, and its names.
std::vector<std::string> own_hosts(int family) {
  std::vector<std::string> hosts;
  ifaddrs* list = nullptr;
  if (getifaddrs(&list) == 0) {
    const std::unique_ptr<ifaddrs, decltype(&freeifaddrs)> owner(list, &freeifaddrs);
    for (const ifaddrs* one = list; one != nullptr; one = one->ifa_next)
      if (one->ifa_addr != nullptr && (family == AF_INET6 || one->ifa_addr->sa_family == family))
        hosts.push_back(url_host(*one->ifa_addr));
  }
  std::array<char, 256> name{};
  if (gethostname(name.data(), name.size() - 1) == 0) {
    const std::string full = name.data();
    hosts.push_back(full);
    hosts.push_back(full.substr(0, full.find('.')));
  }
  return hosts;
}

}  // namespace

std::vector<std::string> hosts_of(int fd, const std::vector<std::string>& names) {
  sockaddr_storage address{};
  socklen_t size = sizeof address;
  void* raw = &address;
  std::vector<std::string> hosts{"localhost", "127.0.0.1", "[::1]"};
  if (getsockname(fd, static_cast<sockaddr*>(raw), &size) == 0) {
    hosts.push_back(url_host(*static_cast<sockaddr*>(raw)));
    if (hosts.back().empty())
      for (std::string& own : own_hosts(address.ss_family)) hosts.push_back(std::move(own));
  }
  hosts.insert(hosts.end(), names.begin(), names.end());
  const int port = bound_port(fd);
  std::vector<std::string> values;
  for (std::string& host : hosts) {
    if (host.empty()) continue;
    for (char& c : host)
      if (c >= 'A' && c <= 'Z') c = static_cast<char>(c - 'A' + 'a');
    if (host.front() != '[' && host.find(':') != std::string::npos) host = "[" + host + "]";
    values.push_back(fmt::format("{}:{}", host, port));
    if (port == 80) values.push_back(host);
  }
  return values;
}

ActivatedSockets activated_sockets() {
  ActivatedSockets sockets;
  const int count = sd_listen_fds(1);
  for (int i = 0; i < count; ++i) {
    FileDescriptor fd(SD_LISTEN_FDS_START + i);
    if (sd_is_socket(fd.get(), AF_UNIX, SOCK_STREAM, 1) > 0)
      sockets.unix_sockets.push_back(std::move(fd));
    else if (sd_is_socket(fd.get(), AF_UNSPEC, SOCK_STREAM, 1) > 0)
      sockets.tcp_sockets.push_back(std::move(fd));
  }
  return sockets;
}

}  // namespace lightrig
