#pragma once

#include <arpa/inet.h>
#include <netinet/in.h>
#include <poll.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <array>
#include <chrono>
#include <cstdlib>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <string>
#include <utility>

namespace lightrig {

/// A connection that sends exactly the bytes it is told to: HTTP from the outside, also the kind no
/// library would send.
class RawConnection {
 public:
  explicit RawConnection(const std::filesystem::path& unix_socket) {
    fd_ = socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0);
    sockaddr_un address{};
    address.sun_family = AF_UNIX;
    unix_socket.string().copy(address.sun_path, sizeof(address.sun_path) - 1);
    const void* raw = &address;
    connected_ = connect(fd_, static_cast<const sockaddr*>(raw), sizeof address) == 0;
  }
  explicit RawConnection(int loopback_port) {
    fd_ = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_port = htons(static_cast<std::uint16_t>(loopback_port));
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    const void* raw = &address;
    connected_ = connect(fd_, static_cast<const sockaddr*>(raw), sizeof address) == 0;
  }
  RawConnection(RawConnection&& other) noexcept
      : fd_(std::exchange(other.fd_, -1)), connected_(other.connected_) {}
  RawConnection(const RawConnection&) = delete;
  RawConnection& operator=(const RawConnection&) = delete;
  ~RawConnection() {
    if (fd_ >= 0) close(fd_);
  }

  bool connected() const { return connected_; }
  /// Says that nothing more will be sent.
  void end_sending() { ::shutdown(fd_, SHUT_WR); }
  void send(const std::string& bytes) {
    (void)!::send(fd_, bytes.data(), bytes.size(), MSG_NOSIGNAL);
  }
  /// What arrives within the time, until `enough` stands in it or the other side closes.
  std::string receive(const std::string& enough, std::chrono::milliseconds within) {
    const auto end = std::chrono::steady_clock::now() + within;
    while (received_.find(enough) == std::string::npos) {
      const auto left = std::chrono::duration_cast<std::chrono::milliseconds>(
          end - std::chrono::steady_clock::now());
      pollfd ready{fd_, POLLIN, 0};
      if (left.count() <= 0 || poll(&ready, 1, static_cast<int>(left.count())) <= 0) break;
      std::array<char, 65536> buffer{};
      const ssize_t n = recv(fd_, buffer.data(), buffer.size(), 0);
      if (n <= 0) {
        closed_ = true;
        break;
      }
      received_.append(buffer.data(), static_cast<std::size_t>(n));
    }
    return received_;
  }
  bool closed() const { return closed_; }

 private:
  int fd_ = -1;
  bool connected_ = false, closed_ = false;
  std::string received_;
};

struct RawReply {
  int status = 0;
  std::string head, body;
  std::string how;  ///< what came of the connection, where no answer did
  nlohmann::ordered_json json() const {
    return nlohmann::ordered_json::parse(body, nullptr, false);
  }
};

/// One request on its own connection, closed after it.
inline RawReply request(RawConnection connection, const std::string& method,
                        const std::string& path, const std::string& body = "",
                        const std::string& headers = "") {
  std::string text = method + " " + path + " HTTP/1.1\r\nConnection: close\r\n";
  if (headers.find("Host:") == std::string::npos) text += "Host: localhost\r\n";
  if (method != "GET") text += "Content-Length: " + std::to_string(body.size()) + "\r\n";
  const auto begun = std::chrono::steady_clock::now();
  connection.send(text + headers + "\r\n" + body);
  const std::string all = connection.receive("\x01 never", std::chrono::seconds(60));
  RawReply reply;
  reply.how = !connection.connected() ? "not connected" : connection.closed() ? "closed" : "silent";
  reply.how +=
      " after " +
      std::to_string(
          std::chrono::duration<double>(std::chrono::steady_clock::now() - begun).count()) +
      " s, with " + std::to_string(all.size()) + " bytes";
  const auto end = all.find("\r\n\r\n");
  if (all.size() < 12 || end == std::string::npos) return reply;
  reply.status = std::atoi(all.substr(9, 3).c_str());
  reply.head = all.substr(0, end);
  reply.body = all.substr(end + 4);
  return reply;
}

inline const std::string mutation_headers =
    "X-Lightrig: 1\r\nContent-Type: application/json\r\nX-Lightrig-Client: tester\r\n";

}  // namespace lightrig
