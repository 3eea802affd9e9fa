#include "drivers/usb/serial_port.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <poll.h>
#include <sys/file.h>
#include <sys/ioctl.h>
#include <termios.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <cstring>
#include <optional>
#include <utility>

namespace lightrig {
namespace {

std::optional<speed_t> speed_of(int baud) {
  switch (baud) {
    case 9600:
      return B9600;
    case 19200:
      return B19200;
    case 38400:
      return B38400;
    case 57600:
      return B57600;
    case 115200:
      return B115200;
    case 230400:
      return B230400;
    case 460800:
      return B460800;
    case 921600:
      return B921600;
    default:
      return std::nullopt;
  }
}

tl::unexpected<Error> open_failed(const std::string& device, int number) {
  const std::string said = fmt::format("open {}: {}", device, std::strerror(number));
  if (number == ENOENT || number == ENODEV || number == ENXIO)
    return fail(ErrorCode::not_found, said + "; is the cable in? see `lightrig devices`");
  if (number == EACCES || number == EPERM)
    return fail(ErrorCode::refused, said + "; add the service's user to the group dialout");
  return fail(ErrorCode::refused, said);
}

Result<termios> raw_settings(int fd, const SerialEndpoint& endpoint) {
  termios settings{};
  if (tcgetattr(fd, &settings) != 0)
    return fail(ErrorCode::invalid_input, endpoint.device + " is not a serial port");
  cfmakeraw(&settings);
  settings.c_cflag |= CLOCAL | CREAD;
  settings.c_cflag &= ~static_cast<tcflag_t>(CSTOPB | PARENB | PARODD | CSIZE | CRTSCTS);
  settings.c_cflag |= endpoint.data_bits == 7 ? CS7 : CS8;
  if (endpoint.stop_bits == 2) settings.c_cflag |= CSTOPB;
  if (endpoint.parity != 'N') settings.c_cflag |= PARENB;
  if (endpoint.parity == 'O') settings.c_cflag |= PARODD;
  settings.c_cc[VMIN] = 0;
  settings.c_cc[VTIME] = 0;
  const auto speed = speed_of(endpoint.baud);
  if (!speed)
    return fail(ErrorCode::invalid_input,
                fmt::format("{} baud is not a speed that serial ports here offer", endpoint.baud));
  cfsetispeed(&settings, *speed);
  cfsetospeed(&settings, *speed);
  return settings;
}

}  // namespace

Result<SerialPort> SerialPort::open(const SerialEndpoint& endpoint) {
  SerialPort port;
  port.name_ = endpoint.device;
  port.fd_ = ::open(endpoint.device.c_str(), O_RDWR | O_NOCTTY | O_NONBLOCK | O_CLOEXEC);
  if (port.fd_ < 0) return open_failed(endpoint.device, errno);
  if (flock(port.fd_, LOCK_EX | LOCK_NB) != 0)
    return fail(ErrorCode::refused, endpoint.device + " is in use by another program");
  auto settings = raw_settings(port.fd_, endpoint);
  if (!settings) return tl::unexpected(settings.error());
  if (tcsetattr(port.fd_, TCSANOW, &*settings) != 0)
    return fail(ErrorCode::refused,
                fmt::format("configure {}: {}", endpoint.device, std::strerror(errno)));
  tcflush(port.fd_, TCIOFLUSH);
  return port;
}

SerialPort::SerialPort(SerialPort&& other) noexcept
    : fd_(std::exchange(other.fd_, -1)), name_(std::move(other.name_)) {}

SerialPort& SerialPort::operator=(SerialPort&& other) noexcept {
  std::swap(fd_, other.fd_);
  std::swap(name_, other.name_);
  return *this;
}

SerialPort::~SerialPort() {
  if (fd_ >= 0) close(fd_);
}

Result<std::string> SerialPort::read_some(std::chrono::milliseconds patience) {
  pollfd watch{fd_, POLLIN, 0};
  const int ready = poll(&watch, 1, static_cast<int>(patience.count()));
  if (ready < 0 && errno != EINTR)
    return fail(ErrorCode::disconnected, fmt::format("{}: {}", name_, std::strerror(errno)));
  if (ready <= 0) return std::string();
  std::array<char, 512> buffer{};
  const ssize_t got = read(fd_, buffer.data(), buffer.size());
  if (got > 0) return std::string(buffer.data(), static_cast<std::size_t>(got));
  if (got < 0 && (errno == EAGAIN || errno == EINTR)) return std::string();
  return fail(ErrorCode::disconnected,
              fmt::format("{}: {}", name_, got == 0 ? "hung up" : std::strerror(errno)));
}

Result<void> SerialPort::write_all(std::string_view bytes, std::chrono::milliseconds patience) {
  const auto deadline = std::chrono::steady_clock::now() + patience;
  while (!bytes.empty()) {
    const ssize_t sent = write(fd_, bytes.data(), bytes.size());
    if (sent > 0) {
      bytes.remove_prefix(static_cast<std::size_t>(sent));
      continue;
    }
    if (sent < 0 && errno != EAGAIN && errno != EINTR)
      return fail(ErrorCode::disconnected, fmt::format("{}: {}", name_, std::strerror(errno)));
    if (std::chrono::steady_clock::now() >= deadline)
      return fail(ErrorCode::timed_out, name_ + " takes no more bytes");
    pollfd watch{fd_, POLLOUT, 0};
    poll(&watch, 1, 5);
  }
  return {};
}

}  // namespace lightrig
