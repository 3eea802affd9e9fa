#include "daemon/session/session_folder.h"

#include <fmt/format.h>

#include <algorithm>
#include <system_error>

#include "config/read_rig.h"
#include "daemon/session/durable_file.h"
#include "daemon/session/input_files.h"
#include "daemon/session/json_cursor.h"
#include "daemon/session/json_parse.h"
#include "daemon/session/plan_json.h"

namespace lightrig {
namespace {

namespace fs = std::filesystem;

StoredFrame frame_of(const JsonCursor& at, const std::string& role) {
  StoredFrame frame;
  frame.file = at["file"].text();
  frame.role = role.empty() ? at["role"].text() : role;
  frame.exposure = at["exposure_s"].number();
  frame.sha256 = at["sha256"].text();
  // The journal is read from disk: a name in it must not lead out of the folder.
  if (!stays_inside(frame.file)) at["file"].reject("leads out of the session folder");
  return frame;
}

CapturedShot shot_of(const JsonCursor& at) {
  CapturedShot shot;
  shot.name = at["name"].text();
  shot.index = at["index"].small_integer();
  shot.held_out = at["held_out"].boolean();
  for (const JsonCursor& frame : at["frames"].items()) shot.frames.push_back(frame_of(frame, ""));
  shot.exposures_skipped = at["skipped_s"].numbers();
  shot.elapsed_s = at["measured"]["elapsed_s"].number();
  shot.lamp_power = at["lamp_power"].number();
  return shot;
}

void forget(std::vector<CapturedShot>& shots, const std::string& name) {
  std::erase_if(shots, [&](const CapturedShot& shot) { return shot.name == name; });
}

void apply(const JournalEvent& event, const JsonCursor& at, Captured& captured) {
  if (event.event == "dark") {
    captured.darks.clear();
    for (const JsonCursor& frame : at["frames"].items()) {
      captured.darks.push_back(frame_of(frame, "dark"));
    }
  } else if (event.event == "shot") {
    CapturedShot shot = shot_of(at);
    forget(captured.shots, shot.name);
    captured.shots.push_back(std::move(shot));
  } else if (event.event == "retake") {
    forget(captured.shots, at["name"].text());
    ++captured.retakes[at["name"].text()];
    captured.state = "paused";
    captured.sealed = false;
  } else if (event.event == "started" || event.event == "resumed") {
    captured.state = "capturing";
    captured.outcome_reason.clear();
  } else if (event.event == "paused") {
    captured.state = "paused";
    captured.outcome_reason = at["reason"].text();
  } else if (event.event == "ended") {
    const std::string outcome = at["outcome"].text();
    captured.state = outcome == "stopped_early" ? "done" : outcome;
    captured.outcome_reason = at["reason"].text();
  } else if (event.event == "sealed") {
    captured.sealed = true;
  }
  if (at.has("measured") && at["measured"].has("elapsed_s")) {
    captured.elapsed_s = std::max(captured.elapsed_s, at["measured"]["elapsed_s"].number());
  }
}

struct Identity {
  std::string id;
  std::vector<InputFile> inputs;
};

Result<Identity> identity_of(const SessionFolder& folder) {
  const auto text = read_file(folder.session_json());
  if (!text) {
    return fail(text.error().code, fmt::format("'{}' is not a session folder: {}",
                                               folder.root.string(), text.error().message));
  }
  const auto json = parse_json(*text);
  if (!json) {
    return tl::unexpected(
        with_context(fmt::format("read '{}'", folder.session_json().string()), json.error()));
  }
  std::string problem;
  const JsonCursor root(*json, problem);
  if (root["schema"].text() != "lightrig.session/1") {
    root["schema"].reject("is not lightrig.session/1");
  }
  Identity identity{root["id"].text(), {}};
  for (const JsonCursor& input : root["inputs"].items()) {
    identity.inputs.push_back(
        {input["role"].text(), input["file"].text(), input["from"].text(), input["sha256"].text()});
  }
  if (!problem.empty()) {
    return fail(ErrorCode::invalid_input,
                fmt::format("read '{}': {}", folder.session_json().string(), problem));
  }
  return identity;
}

/// The value a configuration file was read to, or its first error.
template <class T>
Result<T> value_of(Read<T> read) {
  if (read.value) return std::move(*read.value);
  for (const Diagnostic& diagnostic : read.diagnostics) {
    if (diagnostic.severity == Diagnostic::Severity::error) {
      return fail(ErrorCode::invalid_input, to_text(diagnostic, read.text));
    }
  }
  return fail(ErrorCode::invalid_input, "the file cannot be read");
}

Result<void> read_configuration(SessionRecord& record) {
  // What the files name lies under inputs/; where it was when they were written does not matter.
  auto rig = value_of(read_rig(record.folder.rig_toml(), NamedFiles::may_be_absent));
  if (!rig) return tl::unexpected(rig.error());
  record.rig = std::move(*rig);
  std::error_code ignored;
  const bool own_file = fs::exists(record.folder.session_toml(), ignored);
  auto spec = value_of(read_session(own_file ? record.folder.session_toml() : fs::path(),
                                    record.rig, NamedFiles::may_be_absent));
  if (!spec) return tl::unexpected(spec.error());
  record.spec = std::move(*spec);
  return {};
}

/// plan.json names the files it was made from, by their bytes: a rig file changed afterwards would
/// silently give another BRDF from the same frames.
Result<void> check_configuration(const SessionRecord& record) {
  const auto changed = [](const char* file) {
    return fail(ErrorCode::invalid_input,
                fmt::format("{} is not the one the session was captured with; restore it (its "
                            "SHA-256 stands in plan.json)",
                            file));
  };
  if (sha256_hex(record.rig.text) != record.plan.inputs.rig) return changed("rig.toml");
  const std::string session = record.spec.text.empty() ? "" : sha256_hex(record.spec.text);
  if (session != record.plan.inputs.session) return changed("session.toml");
  return {};
}

}  // namespace

bool stays_inside(const fs::path& name) {
  return !name.empty() && !name.is_absolute() &&
         std::ranges::find(name, fs::path("..")) == name.end();
}

std::string shot_name(const Plan& plan, int index) {
  const bool held_out = plan.shots[static_cast<std::size_t>(index)].held_out;
  const auto same = std::count_if(plan.shots.begin(), plan.shots.begin() + index + 1,
                                  [&](const Shot& shot) { return shot.held_out == held_out; });
  return fmt::format("{}{:02d}", held_out ? 'H' : 'L', same);
}

Result<Captured> captured_of(const std::vector<JournalEvent>& events) {
  Captured captured;
  for (const JournalEvent& event : events) {
    std::string problem;
    apply(event, JsonCursor(event.fields, problem), captured);
    if (!problem.empty()) {
      return fail(ErrorCode::invalid_input,
                  fmt::format("journal event {} ({}): {}", event.sequence, event.event, problem));
    }
  }
  return captured;
}

Result<SessionRecord> read_session_folder(const fs::path& root) {
  SessionRecord record;
  record.folder.root = root;
  auto identity = identity_of(record.folder);
  if (!identity) return tl::unexpected(identity.error());
  record.id = std::move(identity->id);
  const auto in_folder = [&](const Error& error) {
    return tl::unexpected(with_context("read session '" + root.string() + "'", error));
  };
  if (auto read = read_configuration(record); !read) return in_folder(read.error());
  if (auto used = use_inputs(record.folder, identity->inputs, record.rig, record.spec); !used) {
    return tl::unexpected(used.error());
  }
  const auto plan_text = read_file(record.folder.plan_json());
  if (!plan_text) return in_folder(plan_text.error());
  auto plan = plan_from_json(*plan_text);
  if (!plan) return in_folder(plan.error());
  record.plan = std::move(*plan);
  if (auto unchanged = check_configuration(record); !unchanged) return in_folder(unchanged.error());
  auto replay = replay_journal(record.folder.journal());
  if (!replay) return in_folder(replay.error());
  auto captured = captured_of(replay->events);
  if (!captured) return in_folder(captured.error());
  for (const JournalEvent& event : replay->events) {
    if (event.event != "replanned") continue;
    if (auto taken_up = apply_replanned(event.fields, record.plan); !taken_up) {
      return in_folder(
          {ErrorCode::invalid_input, fmt::format("journal event {} (replanned): {}", event.sequence,
                                                 taken_up.error().message)});
    }
  }
  for (const CapturedShot& shot : captured->shots) {
    if (shot.index < 0 || static_cast<std::size_t>(shot.index) >= record.plan.shots.size() ||
        shot_name(record.plan, shot.index) != shot.name) {
      return in_folder({ErrorCode::invalid_input,
                        fmt::format("the journal tells of shot {} as light {}, which plan.json "
                                    "does not have",
                                    shot.name, shot.index)});
    }
  }
  record.darks = std::move(captured->darks);
  record.shots = std::move(captured->shots);
  record.state = std::move(captured->state);
  record.sealed = captured->sealed;
  record.events = std::move(replay->events);
  return record;
}

}  // namespace lightrig
