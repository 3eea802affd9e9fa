#pragma once

#include <string>

#include "core/result.h"

namespace lightrig::sim {

/// A serial line whose far end is ours: a pseudo-terminal, found at a path of the caller's choice
/// by a symbolic link that goes with it.
class Pty {
 public:
  Pty() = default;
  ~Pty() { close(); }
  Pty(const Pty&) = delete;
  Pty& operator=(const Pty&) = delete;

  /// Opens a new one, raw and non-blocking at our end, and links `path` to it; "" links nothing.
  /// Gives its own name, /dev/pts/N. Errors: refused.
  Result<std::string> open(const std::string& path);
  /// As if its plug were pulled; open() makes another.
  void close();

  bool is_open() const { return master_ >= 0; }
  int descriptor() const { return master_; }  ///< of our end; −1 while closed

 private:
  int master_ = -1;
  int slave_ = -1;  ///< held open: a pty whose slave nobody holds hangs up
  std::string link_;
};

}  // namespace lightrig::sim
