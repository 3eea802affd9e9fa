#include "config/read_bytes.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>

#include "config/file_descriptor.h"

namespace lightrig {
namespace {

constexpr off_t largest_file = off_t{4} << 30;  // [byte]
constexpr const char* too_large = "it exceeds 4 GiB";

tl::unexpected<Error> system_failure() {
  const int number = errno;
  const bool absent = number == ENOENT || number == ENOTDIR;
  return fail(absent ? ErrorCode::not_found : ErrorCode::refused, std::strerror(number));
}

template <class Bytes>
Result<Bytes> read_whole(const std::filesystem::path& file) {
  // Not blocking: a FIFO named by mistake must not hold the program up.
  const FileDescriptor opened(::open(file.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK));
  if (!opened.valid()) return system_failure();
  struct stat facts {};
  if (::fstat(opened.get(), &facts) != 0) return system_failure();
  if (S_ISDIR(facts.st_mode))
    return fail(ErrorCode::invalid_input, "it is a directory; name the file in it");
  if (!S_ISREG(facts.st_mode)) return fail(ErrorCode::invalid_input, "it is not a regular file");

  if (facts.st_size > largest_file) return fail(ErrorCode::invalid_input, too_large);
  // The size is where to begin, not where to end: files of /proc say 0, a journal grows meanwhile.
  Bytes bytes;
  off_t done = 0;
  for (off_t room = facts.st_size + 1; done <= largest_file; room = done + 65536) {
    bytes.resize(static_cast<std::size_t>(std::min(room, largest_file + 1)));
    while (done < static_cast<off_t>(bytes.size())) {
      const ssize_t n =
          ::read(opened.get(), bytes.data() + done, bytes.size() - static_cast<std::size_t>(done));
      if (n < 0 && errno == EINTR) continue;
      if (n < 0) return system_failure();
      if (n == 0) {
        bytes.resize(static_cast<std::size_t>(done));
        return bytes;
      }
      done += n;
    }
  }
  return fail(ErrorCode::invalid_input, too_large);
}

}  // namespace

Result<std::vector<std::byte>> read_bytes(const std::filesystem::path& file) {
  return read_whole<std::vector<std::byte>>(file);
}

Result<std::string> read_byte_string(const std::filesystem::path& file) {
  return read_whole<std::string>(file);
}

}  // namespace lightrig
