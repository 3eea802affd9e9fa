#include <fmt/chrono.h>
#include <fmt/format.h>
#include <sys/utsname.h>

#include <cctype>
#include <cerrno>
#include <system_error>

#include "config/json_text.h"
#include "daemon/session/durable_file.h"
#include "daemon/session/input_files.h"
#include "daemon/session/plan_json.h"
#include "daemon/session/session.h"

namespace lightrig {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

/// The processor's name: results are equal in bytes on one build and CPU, so both are recorded.
std::string cpu_model() {
  const std::string text = read_file("/proc/cpuinfo").value_or("");
  const std::size_t key = text.find("model name");
  const std::size_t colon = key == std::string::npos ? key : text.find(": ", key);
  if (colon == std::string::npos) {
    utsname system{};
    return ::uname(&system) == 0 ? system.machine : "unknown";
  }
  return text.substr(colon + 2, text.find('\n', colon) - colon - 2);
}

std::string session_json(const SessionSpec& spec, const std::string& id,
                         const std::vector<InputFile>& inputs) {
  Json json;
  json["schema"] = "lightrig.session/1";
  json["id"] = id;
  json["sample_id"] = spec.sample_id;
  json["operator"] = spec.operator_name;
  json["notes"] = spec.notes;
  json["inputs"] = to_json(inputs);
  json["software"] = {{"version", LIGHTRIG_VERSION}, {"compiler", __VERSION__}};
  json["machine"] = {{"cpu", cpu_model()}};
  return json_text(json, 1) + "\n";
}

bool plain_name(const std::string& id) {
  const auto plain = [](unsigned char c) {
    return std::isalnum(c) != 0 || c == '-' || c == '_' || c == '.';
  };
  return !id.empty() && id.size() <= 200 && id.front() != '.' &&
         std::all_of(id.begin(), id.end(), plain);
}

Result<void> fill(const SessionFolder& folder, const Rig& rig, const SessionSpec& spec,
                  const Prepared& prepared, const std::string& id) {
  if (auto r = make_folder(folder.root); !r) return r;
  if (auto r = write_durably(folder.rig_toml(), rig.text); !r) return r;
  if (!spec.text.empty()) {
    if (auto r = write_durably(folder.session_toml(), spec.text); !r) return r;
  }
  if (auto r = write_durably(folder.plan_json(), plan_to_json(rig, spec, prepared)); !r) return r;
  const auto inputs = copy_inputs(folder, rig, spec, prepared.materials);
  if (!inputs) return tl::unexpected(inputs.error());
  if (auto r = write_durably(folder.session_json(), session_json(spec, id, *inputs)); !r) return r;
  auto journal = Journal::open(folder.journal());
  if (!journal) return tl::unexpected(journal.error());
  const auto opened = journal->append("opened", {{"schema", "lightrig.journal/1"},
                                                 {"id", id},
                                                 {"rig", rig.name},
                                                 {"lights", prepared.plan.shots.size()}});
  if (!opened) return tl::unexpected(opened.error());
  return {};
}

}  // namespace

std::string make_session_id(const SessionSpec& spec, std::chrono::system_clock::time_point now) {
  std::string id =
      fmt::format("{:%Y%m%dT%H%M%SZ}", fmt::gmtime(std::chrono::system_clock::to_time_t(now)));
  if (!spec.sample_id.empty()) id += '-';
  for (const char c : spec.sample_id.substr(0, 100)) {
    id += std::isalnum(static_cast<unsigned char>(c)) != 0 || c == '_' || c == '.' ? c : '-';
  }
  return id;
}

Result<SessionFolder> create_session(const Rig& rig, const SessionSpec& spec,
                                     const Prepared& prepared, const std::string& id) {
  const SessionFolder folder{rig.session_root / id};
  const auto failed = [&](const Error& error) {
    return tl::unexpected(with_context("create session '" + folder.root.string() + "'", error));
  };
  if (!plain_name(id)) {
    return failed({ErrorCode::refused,
                   "the id may hold letters, digits, '-', '_' and '.', and not begin with '.'"});
  }
  std::error_code problem;
  if (fs::exists(folder.root, problem)) {
    return failed({ErrorCode::refused, "there is a session of this id already: choose another"});
  }
  // Filled under another name first: a folder under its own name is always a whole session.
  const SessionFolder part{rig.session_root / ("." + id + ".part")};
  fs::remove_all(part.root, problem);
  if (auto filled = fill(part, rig, spec, prepared, id); !filled) {
    fs::remove_all(part.root, problem);
    return failed(filled.error());
  }
  fs::rename(part.root, folder.root, problem);
  if (problem) return failed({ErrorCode::refused, "rename into place: " + problem.message()});
  if (auto synced = sync_directory(rig.session_root); !synced) return failed(synced.error());
  return folder;
}

}  // namespace lightrig
