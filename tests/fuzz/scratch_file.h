#pragma once

#include <fcntl.h>
#include <unistd.h>

#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <string>

namespace lightrig::fuzz {

/// A file in memory whose contents are the input, for readers that take a path. One a process.
inline const std::string& scratch_file(const std::string& name, const std::uint8_t* data,
                                       std::size_t size) {
  static const std::string path =
      "/dev/shm/lightrig-fuzz-" + std::to_string(::getpid()) + "-" + name;
  const int fd = ::open(path.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0600);
  if (fd < 0 || ::write(fd, data, size) != static_cast<ssize_t>(size)) std::abort();
  ::close(fd);
  return path;
}

}  // namespace lightrig::fuzz
