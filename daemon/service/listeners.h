#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "config/file_descriptor.h"
#include "core/result.h"

namespace lightrig {

/// A file locked for as long as this lives (flock: gone with the process, however it ends).
class LockFile {
 public:
  /// `option` chooses another place, for the message. Errors: refused when another process holds it
  /// (its id, where it wrote one), or when the file cannot be made.
  static Result<LockFile> take(const std::filesystem::path& path, const std::string& what,
                               const std::string& option = "");

 private:
  FileDescriptor fd_;
};

/// A listening Unix socket; its file is removed on destruction if it is still ours.
class UnixListener {
 public:
  /// Mode 0660, group `lightrig` where there is one. A socket file that nobody answers behind is
  /// replaced. Errors: refused when a live service answers there, when the path is taken by
  /// something else than a socket, too long, or not writable.
  static Result<UnixListener> open(const std::filesystem::path& path);
  UnixListener(UnixListener&&) noexcept = default;
  UnixListener& operator=(UnixListener&&) noexcept = default;
  ~UnixListener();

  int fd() const { return fd_.get(); }

 private:
  UnixListener() = default;
  std::filesystem::path path_;
  unsigned long inode_ = 0;
  LockFile lock_;
  FileDescriptor fd_;
};

/// A TCP address to listen on.
struct TcpAddress {
  std::string host;  ///< numeric: "127.0.0.1", "::1"
  int port = 0;
  bool loopback = false;
};

/// "127.0.0.1:8080", "[::1]:8080" or ":8080" (loopback). Errors: invalid_input.
Result<TcpAddress> parse_tcp_address(const std::string& text);

/// A listening TCP socket. Errors: refused with the system's reason.
Result<FileDescriptor> listen_tcp(const TcpAddress& address);

/// The port a TCP socket is really bound to (port 0 asks for any).
int bound_port(int fd);

/// The Host values, lower case, under which a listening TCP socket is asked for: loopback's, its
/// own address (bound to a wildcard: every address and the name of this machine), and `names`, each
/// with the port, and without it where that is 80.
std::vector<std::string> hosts_of(int fd, const std::vector<std::string>& names);

/// Sockets that systemd's socket activation handed in (LISTEN_FDS), told apart by family.
struct ActivatedSockets {
  std::vector<FileDescriptor> unix_sockets, tcp_sockets;
};
ActivatedSockets activated_sockets();

}  // namespace lightrig
