#include "config/read_bytes.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>

namespace lightrig {
namespace {

constexpr off_t largest_file = off_t{4} << 30;  // [byte]

struct Descriptor {
  int fd;
  ~Descriptor() {
    if (fd >= 0) ::close(fd);
  }
};

tl::unexpected<Error> system_failure() {
  const int number = errno;
  return fail(number == ENOENT ? ErrorCode::not_found : ErrorCode::refused, std::strerror(number));
}

}  // namespace

Result<std::vector<std::byte>> read_bytes(const std::filesystem::path& file) {
  // Not blocking: a FIFO named by mistake must not hold the program up.
  const Descriptor opened{::open(file.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK)};
  if (opened.fd < 0) return system_failure();
  struct stat facts {};
  if (::fstat(opened.fd, &facts) != 0) return system_failure();
  if (S_ISDIR(facts.st_mode))
    return fail(ErrorCode::invalid_input, "it is a directory; name the file in it");
  if (!S_ISREG(facts.st_mode)) return fail(ErrorCode::invalid_input, "it is not a regular file");
  if (facts.st_size > largest_file) return fail(ErrorCode::invalid_input, "it exceeds 4 GiB");

  std::vector<std::byte> bytes(static_cast<std::size_t>(facts.st_size));
  std::size_t done = 0;
  while (done < bytes.size()) {
    const ssize_t n = ::read(opened.fd, bytes.data() + done, bytes.size() - done);
    if (n < 0 && errno == EINTR) continue;
    if (n < 0) return system_failure();
    if (n == 0) break;
    done += static_cast<std::size_t>(n);
  }
  bytes.resize(done);
  return bytes;
}

}  // namespace lightrig
