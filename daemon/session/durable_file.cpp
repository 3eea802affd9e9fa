#include "daemon/session/durable_file.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <openssl/evp.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>
#include <system_error>
#include <vector>

#include "config/file_descriptor.h"
#include "config/read_bytes.h"

namespace lightrig {
namespace {

namespace fs = std::filesystem;

/// The error of a system call on a path, with what a person can do about it.
tl::unexpected<Error> system_failure(std::string_view doing, const fs::path& path, int number) {
  const bool full = number == ENOSPC || number == EDQUOT;
  const char* remedy = full ? "; free some space there" : "";
  if (number == EACCES || number == EPERM || number == EROFS) {
    remedy = "; check the owner and mode of the folder, and that the disk is mounted for writing";
  } else if (number == ENOTDIR || number == ENOENT) {
    remedy = "; the folder it stands in is missing, or is a file";
  }
  return fail(full ? ErrorCode::no_space : ErrorCode::refused,
              fmt::format("{} '{}': {}{}", doing, path.string(),
                          std::generic_category().message(number), remedy));
}

Result<void> write_all(const FileDescriptor& file, const fs::path& path,
                       std::span<const std::byte> bytes) {
  while (!bytes.empty()) {
    const ssize_t n = ::write(file.get(), bytes.data(), bytes.size());
    if (n < 0 && errno == EINTR) continue;
    if (n < 0) return system_failure("write", path, errno);
    // write() of a positive count never returns 0 on a regular file but when nothing fits.
    if (n == 0) return system_failure("write", path, ENOSPC);
    bytes = bytes.subspan(static_cast<std::size_t>(n));
  }
  if (::fsync(file.get()) != 0) return system_failure("flush to disk", path, errno);
  return {};
}

/// Compares what the disk now holds with what was meant. The page cache is asked to forget the file
/// first, so that on a real disk this reads the medium and not our own memory.
Result<void> check_written(const fs::path& path, std::span<const std::byte> bytes) {
  FileDescriptor file(::open(path.c_str(), O_RDONLY | O_CLOEXEC));
  if (!file.valid()) return system_failure("read back", path, errno);
  ::posix_fadvise(file.get(), 0, 0, POSIX_FADV_DONTNEED);
  std::vector<std::byte> block(std::size_t{1} << 18);
  std::size_t done = 0;
  while (true) {
    const ssize_t n = ::read(file.get(), block.data(), block.size());
    if (n < 0 && errno == EINTR) continue;
    if (n < 0) return system_failure("read back", path, errno);
    if (n == 0) break;
    const auto count = static_cast<std::size_t>(n);
    if (count > bytes.size() - done || std::memcmp(block.data(), bytes.data() + done, count) != 0) {
      return fail(ErrorCode::refused,
                  fmt::format("read back '{}': byte {} onward is not what was written; the disk or "
                              "its driver is faulty: check it before capturing again",
                              path.string(), done));
    }
    done += count;
  }
  if (done != bytes.size()) {
    return fail(ErrorCode::no_space,
                fmt::format("read back '{}': the disk kept {} of {} bytes without reporting an "
                            "error; free some space there",
                            path.string(), done, bytes.size()));
  }
  return {};
}

Result<void> write_part(const fs::path& part, std::span<const std::byte> bytes) {
  FileDescriptor file(::open(part.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0644));
  if (!file.valid()) return system_failure("create", part, errno);
  if (auto written = write_all(file, part, bytes); !written) return written;
  if (const int number = file.close(); number != 0) return system_failure("close", part, number);
  return check_written(part, bytes);
}

}  // namespace

Result<void> sync_directory(const fs::path& folder) {
  FileDescriptor directory(::open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC));
  if (!directory.valid()) return system_failure("open folder", folder, errno);
  if (::fsync(directory.get()) != 0) return system_failure("flush folder", folder, errno);
  return {};
}

Result<void> make_folder(const fs::path& folder) {
  const fs::path parent = folder.parent_path();
  std::error_code ignored;
  if (fs::is_directory(folder, ignored)) return {};
  if (!parent.empty() && parent != folder) {
    if (auto made = make_folder(parent); !made) return made;
  }
  if (::mkdir(folder.c_str(), 0755) != 0 && errno != EEXIST) {
    return system_failure("make folder", folder, errno);
  }
  return parent.empty() ? Result<void>{} : sync_directory(parent);
}

Result<void> write_durably(const fs::path& path, std::span<const std::byte> bytes) {
  fs::path part = path;
  part += ".part";
  auto result = write_part(part, bytes);
  if (result && ::rename(part.c_str(), path.c_str()) != 0) {
    result = system_failure("rename into place", path, errno);
  }
  if (!result) {
    ::unlink(part.c_str());
    return result;
  }
  return sync_directory(path.has_parent_path() ? path.parent_path() : fs::path("."));
}

Result<void> write_durably(const fs::path& path, const std::string& text) {
  return write_durably(path, std::as_bytes(std::span(text)));
}

Result<void> move_durably(const fs::path& from, const fs::path& to) {
  if (auto made = make_folder(to.parent_path()); !made) return made;
  if (::rename(from.c_str(), to.c_str()) != 0) return system_failure("move", from, errno);
  if (auto synced = sync_directory(to.parent_path()); !synced) return synced;
  return sync_directory(from.parent_path());
}

Result<std::string> read_file(const fs::path& path) {
  auto text = read_byte_string(path);
  if (text) return text;
  const ErrorCode code = text.error().code;
  const char* remedy = code == ErrorCode::refused ? "; check who may read it" : "";
  return fail(
      code,
      fmt::format("read '{}': {}{}", path.string(),
                  code == ErrorCode::not_found ? "no such file" : text.error().message, remedy));
}

std::string sha256_hex(std::span<const std::byte> bytes) {
  std::array<unsigned char, EVP_MAX_MD_SIZE> digest{};
  unsigned int length = 0;
  EVP_Digest(bytes.data(), bytes.size(), digest.data(), &length, EVP_sha256(), nullptr);
  std::string hex;
  for (unsigned int i = 0; i < length; ++i) hex += fmt::format("{:02x}", digest[i]);
  return hex;
}

std::string sha256_hex(const std::string& text) {
  return sha256_hex(std::as_bytes(std::span(text)));
}

}  // namespace lightrig
