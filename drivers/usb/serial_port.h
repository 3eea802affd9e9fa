#pragma once

#include <chrono>
#include <cstddef>
#include <span>
#include <string>

#include "config/rig.h"
#include "core/result.h"

namespace lightrig {

/// A byte stream over a tty (termios, raw, exclusive). Reads and writes are timed and never block
/// longer.
class SerialPort {
 public:
  /// Errors: not_found, refused (no permission, in use by another program), each with the remedy.
  static Result<SerialPort> open(const SerialEndpoint& endpoint);
  SerialPort(SerialPort&& other) noexcept;
  SerialPort& operator=(SerialPort&& other) noexcept;
  ~SerialPort();

  /// What has come, at least one byte unless the time ran out (then empty). Errors: disconnected.
  Result<std::string> read_some(std::chrono::milliseconds patience);
  /// Errors: disconnected, timed_out (the other end takes nothing).
  Result<void> write_all(std::string_view bytes, std::chrono::milliseconds patience);

 private:
  SerialPort() = default;
  int fd_ = -1;
  std::string name_;
};

}  // namespace lightrig
