#include "sim/pty.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <pty.h>
#include <termios.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <cstring>
#include <filesystem>

namespace lightrig::sim {

Result<std::string> Pty::open(const std::string& path) {
  close();
  std::array<char, 128> name{};
  termios raw{};
  cfmakeraw(&raw);
  if (openpty(&master_, &slave_, name.data(), &raw, nullptr) != 0)
    return fail(ErrorCode::refused, fmt::format("open a pty: {}", std::strerror(errno)));
  fcntl(master_, F_SETFL, O_NONBLOCK);
  if (path.empty()) return std::string(name.data());
  std::error_code error;
  if (std::filesystem::is_symlink(path, error)) std::filesystem::remove(path, error);
  std::filesystem::create_symlink(name.data(), path, error);
  if (error)
    return fail(ErrorCode::refused,
                fmt::format("link {} to the pty {}: {}", path, name.data(), error.message()));
  link_ = path;
  return std::string(name.data());
}

void Pty::close() {
  for (int* descriptor : {&master_, &slave_}) {
    if (*descriptor >= 0) ::close(*descriptor);
    *descriptor = -1;
  }
  std::error_code ignored;
  if (!link_.empty()) std::filesystem::remove(link_, ignored);
  link_.clear();
}

}  // namespace lightrig::sim
