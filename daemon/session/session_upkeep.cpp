#include "daemon/session/session_upkeep.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/file.h>

#include <algorithm>
#include <cerrno>
#include <system_error>

#include "daemon/session/durable_file.h"
#include "daemon/session/session.h"

namespace lightrig {
namespace {

namespace fs = std::filesystem;

}  // namespace

Result<std::vector<fs::path>> files_below(const fs::path& folder, const fs::path& root) {
  std::vector<fs::path> files;
  std::error_code problem;
  if (!fs::exists(folder, problem)) return files;
  for (fs::recursive_directory_iterator it(folder, problem), end; !problem && it != end;
       it.increment(problem)) {
    if (it->is_regular_file(problem) && !it->is_symlink(problem)) {
      files.push_back(it->path().lexically_relative(root));
    }
  }
  if (problem) {
    return fail(ErrorCode::refused,
                fmt::format("list '{}': {}", folder.string(), problem.message()));
  }
  std::ranges::sort(files);
  return files;
}

Result<FileDescriptor> hold_folder(const SessionFolder& folder) {
  FileDescriptor held(::open(folder.journal().c_str(), O_RDONLY | O_CLOEXEC));
  if (!held.valid() || ::flock(held.get(), LOCK_EX | LOCK_NB) != 0)
    return fail(ErrorCode::refused,
                fmt::format("hold session '{}': {}", folder.root.string(),
                            held.valid() && errno == EWOULDBLOCK
                                ? "another process captures into it or reduces it; wait for its end"
                                : std::generic_category().message(errno)));
  return held;
}

bool is_finished(const SessionFolder& folder) {
  std::error_code ignored;
  if (!fs::exists(folder.manifest(), ignored)) return false;
  const auto replay = replay_journal(folder.journal());
  if (!replay) return false;
  const auto captured = captured_of(replay->events);
  return captured && captured->sealed && captured->state == "done";
}

Result<std::vector<std::string>> set_aside_frames(const SessionFolder& folder,
                                                  const std::set<fs::path>& vouched_for,
                                                  std::uint64_t sequence) {
  const auto files = files_below(folder.frames(), folder.root);
  if (!files) return tl::unexpected(files.error());
  std::vector<std::string> moved;
  for (const fs::path& file : *files) {
    if (vouched_for.contains(file)) continue;
    const fs::path to = folder.rejected() / std::to_string(sequence) / file;
    if (auto done = move_durably(folder.root / file, to); !done) {
      return tl::unexpected(with_context("set aside a frame", done.error()));
    }
    moved.push_back(file.string());
  }
  return moved;
}

Result<void> retake_shot(const SessionFolder& folder, const std::string& name) {
  auto journal = Journal::open(folder.journal());
  if (!journal) return tl::unexpected(with_context("retake " + name, journal.error()));
  const auto captured = captured_of(journal->replayed());
  if (!captured) return tl::unexpected(with_context("retake " + name, captured.error()));
  const auto known = [&](const CapturedShot& shot) { return shot.name == name; };
  if (std::ranges::none_of(captured->shots, known)) {
    std::string names;
    for (const CapturedShot& shot : captured->shots) names += " " + shot.name;
    return fail(ErrorCode::not_found,
                fmt::format("retake {}: the session has no such shot; it has{}", name,
                            names.empty() ? " none" : names));
  }
  // Once this stands in the journal the shot's frames are nobody's, and the next capture sets them
  // aside.
  const auto noted = journal->append("retake", {{"name", name}});
  if (!noted) return tl::unexpected(with_context("retake " + name, noted.error()));
  return {};
}

Result<void> seal_session(const SessionFolder& folder, const Patience& patience) {
  const std::string doing = "seal session '" + folder.root.string() + "'";
  auto journal = Journal::open(folder.journal());
  if (!journal) return tl::unexpected(with_context(doing, journal.error()));
  const auto captured = captured_of(journal->replayed());
  if (!captured) return tl::unexpected(with_context(doing, captured.error()));
  if (captured->state != "done" && captured->state != "aborted") {
    return fail(ErrorCode::refused,
                doing + ": it is " + captured->state + "; let it end first, or abort it");
  }
  if (!captured->sealed) {
    const auto noted = journal->append("sealed", {});
    if (!noted) return tl::unexpected(with_context(doing, noted.error()));
  }
  const auto files = files_below(folder.root, folder.root);
  if (!files) return tl::unexpected(with_context(doing, files.error()));
  std::string manifest;
  for (const fs::path& file : *files) {
    if (folder.root / file == folder.manifest() || file.extension() == ".part") continue;
    const auto text = read_file(folder.root / file);
    if (!text) return tl::unexpected(with_context(doing, text.error()));
    manifest += sha256_hex(*text) + "  " + file.generic_string() + "\n";
    patience.tell();
  }
  if (auto written = write_durably(folder.manifest(), manifest); !written) {
    return tl::unexpected(with_context(doing, written.error()));
  }
  return {};
}

}  // namespace lightrig
