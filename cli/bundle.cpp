// bundle: what somebody far away needs to understand what happened, in one file.
#include <fmt/chrono.h>
#include <fmt/format.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <vector>

#include "cli/json_fields.h"
#include "cli/say.h"
#include "cli/service_client.h"
#include "cli/verbs.h"
#include "config/json_text.h"
#include "daemon/session/durable_file.h"
#include "drivers/devices.h"

namespace lightrig::cli {
namespace {

namespace fs = std::filesystem;

// Beyond this a file is cut to its end: the last lines tell most.
constexpr std::size_t most_bytes = std::size_t{8} << 20;

/// A folder that goes with its owner.
class Workshop {
 public:
  Workshop() {
    std::error_code error;
    std::string name = (fs::temp_directory_path(error) / "lightrig-bundle-XXXXXX").string();
    if (!error && mkdtemp(name.data()) != nullptr) path_ = name;
  }
  ~Workshop() {
    std::error_code ignored;
    if (!path_.empty()) fs::remove_all(path_, ignored);
  }
  Workshop(const Workshop&) = delete;
  Workshop& operator=(const Workshop&) = delete;
  const fs::path& path() const { return path_; }

 private:
  fs::path path_;
};

/// What a program printed, and whether it could be run and ended with 0.
struct Output {
  std::string text;
  bool succeeded = false;
};

/// Runs a program found on PATH.
Output output_of(std::vector<std::string> words) {
  std::array<int, 2> ends{};
  if (pipe(ends.data()) != 0) return {};
  posix_spawn_file_actions_t actions;
  posix_spawn_file_actions_init(&actions);
  for (int target : {STDOUT_FILENO, STDERR_FILENO})
    posix_spawn_file_actions_adddup2(&actions, ends[1], target);
  posix_spawn_file_actions_addclose(&actions, ends[0]);
  std::vector<char*> argv;
  for (std::string& word : words) argv.push_back(word.data());
  argv.push_back(nullptr);
  pid_t child = 0;
  const int spawned = posix_spawnp(&child, argv[0], &actions, nullptr, argv.data(), environ);
  posix_spawn_file_actions_destroy(&actions);
  close(ends[1]);
  Output output;
  std::array<char, 1 << 14> block{};
  for (ssize_t n = 0; spawned == 0 && (n = read(ends[0], block.data(), block.size())) > 0;)
    output.text.append(block.data(), static_cast<std::size_t>(n));
  close(ends[0]);
  int status = -1;
  output.succeeded = spawned == 0 && waitpid(child, &status, 0) == child && WIFEXITED(status) &&
                     WEXITSTATUS(status) == 0;
  return output;
}

/// The bundle as it is filled: a file each, and a list of what could not be had.
class Bundle {
 public:
  explicit Bundle(fs::path folder) : folder_(std::move(folder)) {}

  void put(const std::string& name, const Result<std::string>& text) {
    if (!text) return miss(name, text.error().message);
    std::string kept = *text;
    if (kept.size() > most_bytes) {
      kept.erase(0, kept.size() - most_bytes);
      miss(name, fmt::format("only the last {} of {} bytes are kept", most_bytes, text->size()));
    }
    std::error_code error;
    fs::create_directories((folder_ / name).parent_path(), error);
    if (auto written = write_durably(folder_ / name, kept); !written)
      return miss(name, written.error().message);
    ++files_;
  }
  void miss(const std::string& name, const std::string& why) {
    missing_ += fmt::format("{}: {}\n", name, why);
  }
  void end() { put("missing.txt", missing_.empty() ? std::string("nothing\n") : missing_); }
  int files() const { return files_; }

 private:
  fs::path folder_;
  std::string missing_;
  int files_ = 0;
};

void put_session(Bundle& bundle, const fs::path& folder) {
  if (folder.empty())
    return bundle.miss("session", "no session is in hand; name one with --session");
  for (const char* name : {"journal.jsonl", "session.json", "session.toml", "rig.toml", "plan.json",
                           "result/result.json", "manifest-sha256.txt"})
    bundle.put(fmt::format("session/{}", name), read_file(folder / name));
  std::string list;
  std::error_code error;
  for (fs::recursive_directory_iterator it(folder, error), end; !error && it != end;
       it.increment(error))
    if (it->is_regular_file(error))
      list += fmt::format("{:>12} {}\n", it->file_size(error),
                          it->path().lexically_relative(folder).string());
  bundle.put("session/files.txt", list);
}

void put_machine(Bundle& bundle) {
  std::string backends_text;
  for (const Backend& backend : lightrig::backends())
    backends_text +=
        fmt::format("{} {}\n", backend.name, backend.built ? "built in" : backend.remedy);
  bundle.put("lightrig.txt", fmt::format("lightrig {}\ncompiler {}\n{}", LIGHTRIG_VERSION,
                                         __VERSION__, backends_text));
  for (const char* file : {"/proc/version", "/proc/meminfo", "/proc/loadavg", "/etc/os-release"})
    bundle.put("machine/" + fs::path(file).filename().string() + ".txt", read_file(file));
  const auto ask = [&](const char* name, std::vector<std::string> words) {
    const Output output = output_of(std::move(words));
    if (output.text.empty()) return bundle.miss(name, "the program is not there, or said nothing");
    bundle.put(name, output.text);
  };
  ask("machine/disks.txt", {"df", "-h"});
  ask("machine/network.txt", {"ip", "address"});
  ask("machine/usb.txt", {"lsusb"});
  ask("unit.txt", {"systemctl", "--no-pager", "status", "lightrigd.service", "lightrigd.socket"});
  ask("journal.txt",
      {"journalctl", "--no-pager", "-o", "short-iso", "-n", "20000", "-u", "lightrigd"});
}

}  // namespace

int bundle(const BundleOptions& options) {
  const Workshop workshop;
  if (workshop.path().empty())
    return complain("bundle: no temporary folder can be made; set TMPDIR");
  const std::string name = fmt::format(
      "lightrig-bundle-{:%Y%m%dT%H%M%SZ}",
      fmt::gmtime(std::chrono::system_clock::to_time_t(std::chrono::system_clock::now())));
  Bundle bundle(workshop.path() / name);
  // A service that is down is what a post-mortem is often about: then the rest is still worth
  // having.
  const ServiceClient client(options.service);
  bundle.put("service/status.json", client.get("/v1/status"));
  bundle.put("service/metrics.txt", client.get("/metrics"));
  bundle.put("service/log.txt", client.get("/v1/log"));
  const auto rig = client.get_json("/v1/rig");
  bundle.put("rig.toml",
             rig ? Result<std::string>(text(*rig, "text")) : tl::unexpected(rig.error()));
  fs::path folder = options.session;
  if (folder.empty())
    if (const auto status = client.get_json("/v1/status");
        status && part(*status, "session").is_object())
      folder = text(part(*status, "session"), "folder");
  put_session(bundle, folder);
  put_machine(bundle);
  bundle.end();
  const fs::path output =
      options.output.empty() ? fs::path(name + ".tar.gz") : fs::path(options.output);
  std::error_code error;
  const fs::path archive = fs::absolute(output, error);
  const Output tar =
      output_of({"tar", "-czf", archive.string(), "-C", workshop.path().string(), name});
  if (error || !tar.succeeded)
    return complain(fmt::format("bundle: tar could not write {}: {}", output.string(),
                                tar.text.empty() ? "it could not be run" : tar.text));
  say(options.service.json
          ? json_text(Json{{"bundle", archive.string()}, {"files", bundle.files()}})
          : fmt::format("{} files in {}; it holds the rig file and the log, no frames and no token",
                        bundle.files(), output.string()));
  return 0;
}

}  // namespace lightrig::cli
