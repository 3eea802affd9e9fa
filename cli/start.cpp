// start and watch: a session as it goes, for a person or a script.
#include <fmt/format.h>

#include <cmath>
#include <filesystem>

#include "cli/json_fields.h"
#include "cli/progress_view.h"
#include "cli/say.h"
#include "cli/service_client.h"
#include "cli/standing.h"
#include "cli/verbs.h"
#include "config/json_text.h"
#include "daemon/session/durable_file.h"
#include "daemon/session/json_parse.h"
#include "daemon/session/plan_json.h"

namespace lightrig::cli {
namespace {

bool has_ended(const std::string& state) {
  return state == "done" || state == "aborted" || state == "faulted" || state == "refused" ||
         state == "captured" || state == "halted";
}

int tell_end(const Json& session, bool json) {
  const std::string state = text(session, "state");
  if (json) say(json_text(session));
  if (state != "done")
    return complain(fmt::format("session {}: {}{}{}", text(session, "id"), state,
                                text(session, "reason").empty() ? "" : ": ",
                                text(session, "reason")));
  if (json) return 0;
  std::string words = fmt::format("session {} is done after {} lights", text(session, "id"),
                                  session.value("shots_done", 0));
  if (session["predicted_error_percent"].is_number())
    words += fmt::format(", predicted error {}",
                         percent(session["predicted_error_percent"].get<double>()));
  if (session["true_error_percent"].is_number())
    words += fmt::format(", true error {}", percent(session["true_error_percent"].get<double>()));
  say(words);
  say("result in " + text(session, "result"));
  return 0;
}

std::string service_ended(const std::string& id, const std::string& state) {
  if (state == "planning")
    return fmt::format(
        "the service ended while session {} was being planned; nothing had moved: start the "
        "service again, then the session anew",
        id);
  return fmt::format(
      "the service ended during session {}; start it again and arm, then lightrig resume {}", id,
      id);
}

// The points of the curve that were not told yet, and how many lights they go up to.
int tell_curve(const Json& session, int told, ProgressView& view) {
  for (const Json& point : part(session, "curve")) {
    const int lights = point.value("lights", 0);
    if (lights <= told) continue;
    told = lights;
    const double truth = number(point, "true_error_percent");
    view.note(fmt::format("  {} light{} in {}: error ≈ {}{}", lights, lights == 1 ? "" : "s",
                          duration(number(point, "elapsed_s")),
                          percent(number(point, "predicted_error_percent")),
                          std::isfinite(truth) ? fmt::format(" (true {})", percent(truth)) : ""));
  }
  return told;
}

// Follows a session to its end: its events for the screen, the state for the verdict.
int follow(const ServiceClient& client, const std::string& id, bool json) {
  ProgressView view(on_terminal(), terminal_width());
  Json last = nullptr;
  std::string state;
  int told = 0;  // lights of the curve
  const auto on_event = [&](std::string_view event, const Json& data) {
    if (event == "state" && text(part(data, "session"), "id") == id) {
      last = data["session"];
      if (!json && text(last, "state") != state) {
        state = text(last, "state");
        const std::string reason = text(last, "reason");
        view.note(state + (reason.empty() ? "" : ": " + reason));
      }
      if (!json) told = tell_curve(last, told, view);
      return !has_ended(text(last, "state"));
    }
    if (const std::string line = standing_warning(data); !json && !line.empty()) view.note(line);
    if (event == "progress" && text(data, "session") == id) {
      if (json)
        say(json_text(data));
      else
        view.show(data);
    }
    return true;
  };
  const auto read = client.events("/v1/events", on_event);
  view.end();
  if (!read && read.error().code == ErrorCode::disconnected && !last.is_null())
    return complain(service_ended(id, text(last, "state")));
  if (!read) return complain(read.error());
  return tell_end(last, json);
}

Result<Json> start_request(const StartOptions& options) {
  Json body{{"key", request_key()}};
  if (!options.session.empty()) {
    std::error_code error;
    const auto path = std::filesystem::canonical(options.session, error);
    if (error)
      return fail(ErrorCode::not_found, fmt::format("cannot read the session file {}: {}",
                                                    options.session, error.message()));
    body["session_path"] = path.string();
  }
  if (!options.plan.empty()) {
    const auto plan = read_file(options.plan);
    if (!plan) return tl::unexpected(with_context("read the plan", plan.error()));
    // Checked here too: here the file has a name.
    if (auto checked = plan_from_json(*plan, options.plan); !checked)
      return tl::unexpected(checked.error());
    auto json = parse_json(*plan);
    if (!json) return tl::unexpected(with_context("read " + options.plan, json.error()));
    body["plan"] = std::move(*json);
  }
  return body;
}

}  // namespace

int start(const StartOptions& options) {
  const auto body = start_request(options);
  if (!body) return complain(body.error());
  const ServiceClient client(options.service);
  const auto reply = client.post("/v1/sessions", *body);
  if (!reply) return complain(reply.error());
  const std::string id = text(*reply, "id");
  if (!options.wait) {
    say(options.service.json ? json_text(*reply)
                             : fmt::format("session {} has begun; lightrig watch follows it", id));
    return 0;
  }
  if (!options.service.json) say("session " + id);
  return follow(client, id, options.service.json);
}

int watch(const ServiceOptions& options) {
  const ServiceClient client(options);
  const auto status = client.get_json("/v1/status");
  if (!status) return complain(status.error());
  if (!status->contains("session") || !(*status)["session"].is_object()) {
    say(options.json ? json_text(Json{{"session", nullptr}})
                     : "no session is under way; lightrig start begins one");
    return 0;
  }
  const Json& session = (*status)["session"];
  if (has_ended(text(session, "state"))) {
    const int code = tell_end(session, options.json);
    // It was done until somebody took a light back.
    if (const std::string open = open_words(client, session); !open.empty() && !options.json)
      say("its result is from before a light was taken back: " + open);
    return code;
  }
  return follow(client, text(session, "id"), options.json);
}

}  // namespace lightrig::cli
