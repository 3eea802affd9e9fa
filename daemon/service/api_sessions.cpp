// What the API answers from the disk: always on the worker, never on a socket's thread.
#include <fmt/format.h>

#include <algorithm>
#include <nlohmann/json.hpp>

#include "config/json_text.h"
#include "config/read_rig.h"
#include "daemon/service/api.h"
#include "daemon/service/api_body.h"
#include "daemon/service/status_json.h"
#include "daemon/session/durable_file.h"
#include "daemon/session/plan_json.h"
#include "daemon/session/session_upkeep.h"
#include "daemon/session/taken_back.h"

namespace lightrig {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

constexpr std::size_t most_listed = 500;
constexpr std::size_t most_examined = 50;  // reading a folder back takes milliseconds

HttpReply json_reply(int status, const Json& json) {
  return {status, json_text(json) + "\n", "application/json", {}};
}

// Folders below the root that are sessions, newest first: ids begin with the UTC time.
std::vector<std::string> session_names(const fs::path& root) {
  std::vector<std::string> names;
  std::error_code error;
  for (const auto& entry : fs::directory_iterator(root, error)) {
    const std::string name = entry.path().filename().string();
    if (session_folder_of(root, name) && fs::exists(entry.path() / "journal.jsonl", error))
      names.push_back(name);
  }
  std::sort(names.rbegin(), names.rend());
  return names;
}

// How far a session that is not finished came; "interrupted" when its service ended without a word.
Json progress_of(const fs::path& folder, bool in_hand, State now) {
  const auto record = read_session_folder(folder);
  if (!record) return {{"state", "damaged"}};
  std::string state = record->state;
  if (state == "capturing" && !in_hand) state = "interrupted";
  if (state == "done" && in_hand && now == State::reducing) state = name_of(now);
  Json json{{"state", state},
            {"shots_done", record->shots.size()},
            {"shots_planned", record->plan.shots.size()}};
  if (auto open = taken_back(record->events); !open.empty()) json["taken_back"] = std::move(open);
  return json;
}

HttpReply file_of(const fs::path& root, const std::string& id, const fs::path& file) {
  const auto folder = session_folder_of(root, id);
  if (!folder) return error_reply(folder.error());
  const fs::path path = *folder / file;
  std::error_code error;
  if (fs::symlink_status(path, error).type() != fs::file_type::regular)
    return error_reply(404, "not_found",
                       fmt::format("session {} has no {} (yet)", id, file.string()));
  auto text = read_file(path);
  if (!text) return error_reply(text.error());
  return {200, std::move(*text), "application/json", {}};
}

// A session file's text has to be a file for its diagnostics to name it.
Result<fs::path> store_text(const fs::path& root, const std::string& text) {
  const fs::path path = root / ".incoming.toml";
  if (auto written = write_durably(path, text); !written)
    return tl::unexpected(with_context("store the session file", written.error()));
  return path;
}

std::string all_errors(const std::vector<Diagnostic>& diagnostics, const std::string& text) {
  std::string all;
  for (const Diagnostic& one : diagnostics) {
    if (!all.empty()) all += '\n';
    all += to_text(one, text);
  }
  return all;
}

Result<SessionSpec> spec_of(const Rig& rig, const StartBody& body) {
  fs::path path = body.session_path;
  if (!body.session_toml.empty()) {
    auto stored = store_text(rig.session_root, body.session_toml);
    if (!stored) return tl::unexpected(stored.error());
    path = *stored;
  }
  if (path.empty()) return rig.session_defaults;
  if (!path.is_absolute())
    return fail(ErrorCode::invalid_input,
                fmt::format("session_path must be absolute, not {}", path.string()));
  auto read = read_session(path, rig);
  if (!read.value) return fail(ErrorCode::invalid_input, all_errors(read.diagnostics, read.text));
  return std::move(*read.value);
}

}  // namespace

HttpAnswer Api::start(const HttpRequest& request, const std::string&) {
  auto body = start_body(request.body);
  if (!body) return error_reply(body.error());
  // Diagnostics quote the file: over the network nobody may have any file of the machine quoted.
  if (request.over_tcp && !body->session_path.empty())
    return error_reply(403, "refused", "session_path is for the Unix socket; send session_toml");
  auto spec = spec_of(service_.rig(), *body);
  if (!spec) return error_reply(spec.error());
  StartRequest start{std::move(*spec), {}, body->key};
  if (!body->plan.empty()) {
    auto plan = plan_from_json(body->plan, "the plan");
    if (!plan) return error_reply(plan.error());
    start.plan = std::move(*plan);
  }
  const auto id = service_.start(caller_of(request), std::move(start));
  if (!id) return error_reply(id.error());
  HttpReply reply = json_reply(201, {{"id", *id}, {"state", "planning"}});
  reply.headers.emplace_back("Location", "/v1/sessions/" + *id);
  return reply;
}

HttpAnswer Api::list_sessions(const HttpRequest&, const std::string&) {
  return HttpLater{[this]() -> HttpReply {
    const fs::path& root = service_.rig().session_root;
    const Snapshot moment = service_.snapshot();
    Json sessions = Json::array();
    std::size_t examined = 0;
    for (const std::string& name : session_names(root)) {
      if (sessions.size() == most_listed) break;
      std::error_code error;
      const bool result = fs::exists(root / name / "result" / "result.json", error);
      Json one{{"id", name}, {"result", result}};
      // A result is none of the session as it is, once a light of it was taken back.
      const bool finished = result && is_finished({root / name});
      if (!finished && examined++ < most_examined)
        one.update(progress_of(root / name,
                               moment.busy && moment.session && moment.session->id == name,
                               moment.state));
      sessions.push_back(std::move(one));
    }
    return json_reply(200, {{"root", root.string()}, {"sessions", std::move(sessions)}});
  }};
}

HttpAnswer Api::session(const HttpRequest&, const std::string& id) {
  return HttpLater{[this, id]() -> HttpReply {
    const auto folder = session_folder_of(service_.rig().session_root, id);
    if (!folder) return error_reply(folder.error());
    const auto record = read_session_folder(*folder);
    if (!record) return error_reply(record.error());
    std::error_code error;
    Json shots = Json::array();
    for (const CapturedShot& shot : record->shots)
      shots.push_back({{"name", shot.name},
                       {"held_out", shot.held_out},
                       {"frames", shot.frames.size()},
                       {"elapsed_s", shot.elapsed_s}});
    return json_reply(200,
                      {{"id", id},
                       {"folder", folder->string()},
                       {"state", record->state},
                       {"sealed", record->sealed && fs::exists(record->folder.manifest(), error)},
                       {"sample_id", record->spec.sample_id},
                       {"operator", record->spec.operator_name},
                       {"shots_planned", record->plan.shots.size()},
                       {"shots", std::move(shots)},
                       {"journal_events", record->events.size()}});
  }};
}

HttpAnswer Api::retake(const HttpRequest& request, const std::string& id) {
  const auto shot = text_member(request.body, "shot");
  if (!shot) return error_reply(422, "invalid_input", "\"shot\" must name a shot, as in L03");
  return HttpLater{[this, id, shot = *shot, caller = caller_of(request)]() -> HttpReply {
    const auto folder = session_folder_of(service_.rig().session_root, id);
    if (!folder) return error_reply(folder.error());
    if (auto done = retake_shot({*folder}, shot); !done) return error_reply(done.error());
    log_.info("retake",
              {{"session", id}, {"shot", shot}, {"by", caller.name}, {"peer", caller.peer}});
    tell_retake(id, {*folder});
    return json_reply(200, {{"ok", true}});
  }};
}

// Who watches that session is told at once, and not only when it is resumed.
void Api::tell_retake(const std::string& id, const SessionFolder& folder) {
  const auto journal = replay_journal(folder.journal());
  if (!journal) return;
  for (const JournalEvent& event : journal->events)
    hub_.publish_of(id, event.sequence, event.event, event_json(id, event));
}

// As it is now: what the journal's `replanned` events changed is in it.
HttpAnswer Api::session_plan(const HttpRequest&, const std::string& id) {
  return HttpLater{[this, id]() -> HttpReply {
    HttpReply stored = file_of(service_.rig().session_root, id, "plan.json");
    if (stored.status != 200) return stored;
    const auto journal = replay_journal(SessionFolder{service_.rig().session_root / id}.journal());
    if (!journal) return stored;
    std::vector<Json> changes;
    for (const JournalEvent& event : journal->events)
      if (event.event == "replanned") changes.push_back(event.fields);
    if (changes.empty()) return stored;
    auto now = with_replanned(stored.body, changes);
    if (!now) return error_reply(now.error());
    stored.body = std::move(*now);
    return stored;
  }};
}

HttpAnswer Api::session_result(const HttpRequest&, const std::string& id) {
  return HttpLater{
      [this, id] { return file_of(service_.rig().session_root, id, "result/result.json"); }};
}

}  // namespace lightrig
