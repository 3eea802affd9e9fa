#include "config/file_descriptor.h"

#include <unistd.h>

#include <cerrno>
#include <utility>

namespace lightrig {

FileDescriptor& FileDescriptor::operator=(FileDescriptor&& other) noexcept {
  std::swap(fd_, other.fd_);
  return *this;
}

FileDescriptor::~FileDescriptor() {
  if (fd_ >= 0) ::close(fd_);
}

int FileDescriptor::release() { return std::exchange(fd_, -1); }

int FileDescriptor::close() { return ::close(release()) == 0 ? 0 : errno; }

}  // namespace lightrig
