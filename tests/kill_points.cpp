// A library to be preloaded into lightrigd: counts the steps by which it reaches the disk below one
// folder, and lets an accident happen at the n-th. The program under test needs no hook for it. A
// step is the moment before or after a call that changes the disk, and the middle of a write: half
// of its bytes are down then.
//
//   LIGHTRIG_KILL_UNDER   the folder       LIGHTRIG_KILL_AT      the step, from 1; 0 counts alone
//   LIGHTRIG_KILL_HOW     kill (SIGKILL), term (SIGTERM), eio and enospc (that call fails, once),
//   erofs (from there on every
//                         call fails), forward and back (the wall clock jumps by an hour)
//   LIGHTRIG_KILL_COUNT   a file that gets the number of steps and, one a line, what each was, at a
//   clean end
#include <dlfcn.h>
#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <array>
#include <atomic>
#include <cerrno>
#include <climits>
#include <csignal>
#include <cstdarg>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <ctime>
#include <mutex>
#include <string>
#include <vector>

namespace {

struct Watch {
  std::string under, how = "kill";
  long at = 0;
  std::mutex mutex;
  long steps = 0;
  std::vector<std::string> story;
};

// Never destroyed: threads may still write while the process ends.
Watch& watch() {
  static Watch& it = *[] {
    auto* made = new Watch;
    const char* under = std::getenv("LIGHTRIG_KILL_UNDER");
    const char* at = std::getenv("LIGHTRIG_KILL_AT");
    const char* how = std::getenv("LIGHTRIG_KILL_HOW");
    if (how != nullptr) made->how = how;
    if (under != nullptr) made->under = std::string(under) + "/";
    if (at != nullptr) made->at = std::atol(at);
    return made;
  }();
  return it;
}

bool is_watched(const char* path) {
  Watch& it = watch();
  return path != nullptr && !it.under.empty() &&
         std::strncmp(path, it.under.c_str(), it.under.size()) == 0;
}

std::string name_of(int fd) {
  std::array<char, PATH_MAX> name{};
  const std::string link = "/proc/self/fd/" + std::to_string(fd);
  const ssize_t n = readlink(link.c_str(), name.data(), name.size() - 1);
  return n > 0 ? std::string(name.data(), static_cast<std::size_t>(n)) : std::string();
}

std::atomic<time_t> jump{0};  // [s] by which the wall clock is off

// One step after another: two threads must not both believe that the n-th is theirs. What the call
// is to fail with; 0: nothing. A failure strikes the next call that has not been made yet.
int step(const char* when, const char* call, const std::string& path) {
  Watch& it = watch();
  const std::lock_guard lock(it.mutex);
  ++it.steps;
  if (it.at == 0)
    it.story.push_back(std::string(when) + " " + call + " " + path.substr(it.under.size()));
  if (it.at == 0 || it.steps < it.at) return 0;
  const bool first = it.steps == it.at;
  if (first && it.how == "kill") raise(SIGKILL);
  if (first && it.how == "term") kill(getpid(), SIGTERM);
  if (first && it.how == "forward") jump = 3600;
  if (first && it.how == "back") jump = -3600;
  if (it.how == "erofs") return EROFS;
  static bool struck = false;
  const int number = it.how == "eio" ? EIO : it.how == "enospc" ? ENOSPC : 0;
  if (number == 0 || struck || when[0] != 'b') return 0;
  struck = true;
  return number;
}

template <class Function>
Function real(const char* name) {
  return reinterpret_cast<Function>(dlsym(RTLD_NEXT, name));
}

template <class Call>
int around(bool watched, const char* call, const std::string& path, Call made) {
  if (!watched) return made();
  if (const int number = step("before", call, path); number != 0) {
    errno = number;
    return -1;
  }
  const int result = made();
  (void)step("after", call, path);
  return result;
}

mode_t mode_of(int flags, va_list arguments) {
  return (flags & O_CREAT) != 0 ? va_arg(arguments, mode_t) : 0;
}

int opened(const char* name, const char* path, int flags, mode_t mode) {
  using Function = int (*)(const char*, int, ...);
  const auto function = real<Function>(name);
  const bool changes = (flags & (O_CREAT | O_TRUNC)) != 0 && is_watched(path);
  return around(changes, "open", path, [&] { return function(path, flags, mode); });
}

__attribute__((destructor)) void tell_count() {
  const char* file = std::getenv("LIGHTRIG_KILL_COUNT");
  if (file == nullptr || watch().under.empty()) return;
  std::FILE* out = std::fopen(file, "w");
  if (out == nullptr) return;
  std::fprintf(out, "%ld\n", watch().steps);
  for (const std::string& one : watch().story) std::fprintf(out, "%s\n", one.c_str());
  std::fclose(out);
}

}  // namespace

extern "C" int open(const char* path, int flags, ...) {
  va_list arguments;
  va_start(arguments, flags);
  const mode_t mode = mode_of(flags, arguments);
  va_end(arguments);
  return opened("open", path, flags, mode);
}

extern "C" int open64(const char* path, int flags, ...) {
  va_list arguments;
  va_start(arguments, flags);
  const mode_t mode = mode_of(flags, arguments);
  va_end(arguments);
  return opened("open64", path, flags, mode);
}

extern "C" ssize_t write(int fd, const void* bytes, size_t size) {
  using Function = ssize_t (*)(int, const void*, size_t);
  static const auto function = real<Function>("write");
  if (watch().under.empty() || fd <= STDERR_FILENO) return function(fd, bytes, size);
  const std::string path = name_of(fd);
  if (!is_watched(path.c_str())) return function(fd, bytes, size);
  if (const int number = step("before", "write", path); number != 0) {
    errno = number;
    return -1;
  }
  const auto* text = static_cast<const char*>(bytes);
  const size_t half = size / 2;
  if (half > 0 && function(fd, text, half) != static_cast<ssize_t>(half)) return -1;
  (void)step("amid", "write", path);
  const ssize_t rest = function(fd, text + half, size - half);
  (void)step("after", "write", path);
  return rest < 0 ? rest : rest + static_cast<ssize_t>(half);
}

extern "C" int fsync(int fd) {
  using Function = int (*)(int);
  static const auto function = real<Function>("fsync");
  if (watch().under.empty()) return function(fd);
  const std::string path = name_of(fd) + "/";
  return around(is_watched(path.c_str()), "fsync", path, [&] { return function(fd); });
}

extern "C" int rename(const char* from, const char* to) noexcept {
  using Function = int (*)(const char*, const char*);
  static const auto function = real<Function>("rename");
  return around(is_watched(to), "rename", to, [&] { return function(from, to); });
}

extern "C" int clock_gettime(clockid_t clock, timespec* time) noexcept {
  using Function = int (*)(clockid_t, timespec*);
  static const auto function = real<Function>("clock_gettime");
  const int result = function(clock, time);
  if (result == 0 && clock == CLOCK_REALTIME) time->tv_sec += jump;
  return result;
}

extern "C" int mkdir(const char* path, mode_t mode) noexcept {
  using Function = int (*)(const char*, mode_t);
  static const auto function = real<Function>("mkdir");
  return around(is_watched(path), "mkdir", path, [&] { return function(path, mode); });
}

extern "C" int unlink(const char* path) noexcept {
  using Function = int (*)(const char*);
  static const auto function = real<Function>("unlink");
  return around(is_watched(path), "unlink", path, [&] { return function(path); });
}

extern "C" int ftruncate(int fd, off_t length) noexcept {
  using Function = int (*)(int, off_t);
  static const auto function = real<Function>("ftruncate");
  const std::string path = name_of(fd);
  return around(is_watched(path.c_str()), "ftruncate", path, [&] { return function(fd, length); });
}
