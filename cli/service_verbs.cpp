// The verbs that talk to the service of one rig.
#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <filesystem>
#include <numbers>
#include <optional>
#include <thread>

#include "cli/json_fields.h"
#include "cli/say.h"
#include "cli/service_client.h"
#include "cli/standing.h"
#include "cli/verbs.h"
#include "config/json_text.h"

namespace lightrig::cli {
namespace {

std::string session_words(const Json& session) {
  std::string words = fmt::format("session    {}: {}", text(session, "id"), text(session, "state"));
  if (!text(session, "reason").empty()) words += " (" + text(session, "reason") + ")";
  words += fmt::format("\n           {} of {} lights", session.value("shots_done", 0),
                       session.value("shots_total", 0));
  if (!text(session, "activity").empty()) words += ", " + text(session, "activity");
  if (number(session, "remaining_s") > 0)
    words += fmt::format(", {} left", duration(number(session, "remaining_s")));
  if (number(session, "predicted_error_percent") > 0)
    words += fmt::format("\n           predicted error {}",
                         percent(number(session, "predicted_error_percent")));
  if (std::isfinite(number(session, "true_error_percent")))
    words += fmt::format(", true error {}", percent(number(session, "true_error_percent")));
  if (!text(session, "result").empty())
    words += "\n           result in " + text(session, "result");
  return words + "\n";
}

std::string device_words(const Json& devices) {
  const Json gantry = devices.value("gantry", Json::object());
  std::string words = "gantry     ";
  words += gantry.value("homed", false) ? "homed" : "not homed";
  if (!text(gantry, "alarm").empty()) words += ", ALARM " + text(gantry, "alarm");
  for (const Json& input : gantry.value("open_interlocks", Json::array()))
    words += ", open: " + input.get<std::string>();
  const double power = number(devices.value("lamp", Json::object()), "power");
  words += fmt::format("\nlamp       {}\n", power > 0 ? fmt::format("on at {:.0f} %", power * 100)
                                                      : std::string("dark"));
  return words + "camera     " + text(devices, "camera") + "\n";
}

std::string status_words(const Json& status) {
  std::string words =
      fmt::format("rig        {}{}\nstate      {}\n", text(status, "rig"),
                  status.value("simulated", false) ? " (simulated)" : "", text(status, "state"));
  if (status.value("lamp_may_be_on", false)) words += "LAMP MAY BE ON\n";
  for (const Json& why : status.value("why_not_ready", Json::array()))
    words += "not ready  " + why.get<std::string>() + "\n";
  if (status.value("ready", false)) words += "ready      a session may start\n";
  if (status.contains("lock") && status["lock"].is_object())
    words += fmt::format("locked by  {} {}\n", text(status["lock"], "name"),
                         text(status["lock"], "note"));
  if (status.contains("devices") && status["devices"].is_object())
    words += device_words(status["devices"]);
  else
    for (const Json& one : status.value("self_test", Json::array()))
      if (one.value("good", false))
        words += fmt::format("found      {}: {} ({} ago)\n", text(one, "device"), text(one, "said"),
                             duration(number(one, "age_s")));
  if (status.contains("session") && status["session"].is_object())
    words += session_words(status["session"]);
  words += fmt::format("disk       {} free\n", bytes(number(status, "disk_free_bytes")));
  return words;
}

// The session in hand, where the person named none.
Result<std::string> session_or_current(const ServiceClient& client, const std::string& id) {
  if (!id.empty()) return id;
  const auto status = client.get_json("/v1/status");
  if (!status) return tl::unexpected(status.error());
  if (!status->contains("session") || !(*status)["session"].is_object())
    return fail(ErrorCode::refused,
                "no session is in hand; name one (lightrig sessions lists them)");
  return text((*status)["session"], "id");
}

int finish(const Result<Json>& reply, bool json, const std::string& done) {
  if (!reply) return complain(reply.error());
  say(json ? json_text(*reply) : done);
  return 0;
}

/// What was asked for, how it is told that it has come, and how long that may take.
struct Ordered {
  const char* what;
  bool (*is_so)(const Json& status);
  std::chrono::seconds within;
  const char* done;
};
bool at_rest(const Json& status) { return !status.value("busy", true); }
const Ordered pausing{"pause",
                      [](const Json& s) { return text(s, "state") == "paused" || at_rest(s); },
                      std::chrono::seconds{60}, "{}: the lamp is dark; lightrig resume goes on"};
const Ordered halting{"halt", &at_rest, std::chrono::seconds{30},
                      "{}: lamp dark; lightrig resume goes on"};
const Ordered stopping{"stop",
                       [](const Json& s) { return text(s, "state") == "reducing" || at_rest(s); },
                       std::chrono::seconds{60},  // and a light's time, see stop_time()
                       "{}: the last light is stored; lightrig watch follows the reduction"};
const Ordered resuming{"resume",
                       [](const Json& s) {
                         return text(s, "state") == "capturing" || text(s, "state") == "reducing" ||
                                at_rest(s);
                       },
                       std::chrono::seconds{60}, "{}; lightrig watch follows it"};
const Ordered aborting{"abort",
                       // Its devices are given back; the light in hand may still be reduced.
                       [](const Json& s) {
                         return part(s, "devices").is_null() &&
                                (at_rest(s) || text(part(s, "session"), "state") == "aborted");
                       },
                       std::chrono::seconds{30}, "{}"};

/// A stop waits for the light in hand: a minute, and three times what a light is predicted to take.
std::chrono::seconds stop_time(const ServiceClient& client) {
  const auto status = client.get_json("/v1/status");
  if (!status) return stopping.within;
  const Json& session = part(*status, "session");
  const int left =
      session.is_object() ? session.value("shots_total", 0) - session.value("shots_done", 0) : 0;
  const double light = number(session, "remaining_s") / std::max(1, left);
  return stopping.within + std::chrono::seconds(light > 0 ? std::llround(3 * light) : 0);
}

/// The state once it is so. Errors: timed_out with the state it is in instead; refused when the
/// session did not take it up.
Result<std::string> wait_until(const ServiceClient& client, const Ordered& ordered) {
  const auto end = std::chrono::steady_clock::now() + ordered.within;
  while (true) {
    const auto status = client.get_json("/v1/status");
    if (!status) return tl::unexpected(status.error());
    const Json& session = part(*status, "session");
    if (ordered.is_so(*status)) {
      if (text(session, "state") == "refused")
        return fail(ErrorCode::refused, text(session, "reason"));
      return text(*status, "state");
    }
    if (std::chrono::steady_clock::now() > end)
      return fail(
          ErrorCode::timed_out,
          fmt::format(
              "{}: not so after {} s; the service is {} ({}). lightrig abort stops everything",
              ordered.what, ordered.within.count(), text(*status, "state"),
              text(session, "activity")));
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
  }
}

// Sends a command and waits until the rig has carried it out.
int carry_out(const ServiceOptions& options, const std::string& path, const Json& body) {
  const ServiceClient client(options);
  const auto reply = client.post(path, body);
  if (!reply) return complain(reply.error());
  const auto end = client.wait_for(reply->value("command", std::uint64_t{0}));
  if (!end) return complain(end.error());
  say(options.json ? json_text(Json{{"ok", true}, {"message", *end}}) : *end);
  return 0;
}

}  // namespace

int status(const ServiceOptions& options) {
  const ServiceClient client(options);
  const auto status = client.get_json("/v1/status");
  if (!status) return complain(status.error());
  if (options.json) {
    say(json_text(*status));
    return 0;
  }
  std::string words = status_words(*status);
  if (const Json& session = part(*status, "session"); !session.is_object())
    words += unfinished_words(client);
  else if (const std::string open = open_words(client, session); !open.empty())
    words += fmt::format("unfinished {}: {}\n", text(session, "id"), open);
  say(words);
  return 0;
}

int command(const ServiceOptions& options, const std::string& verb) {
  return carry_out(options, "/v1/" + verb, Json::object());
}

int jog(const JogOptions& options) {
  const ServiceClient client(options.service);
  const auto rig = client.get_json("/v1/rig");
  if (!rig) return complain(rig.error());
  // The unit is the axis' own; an axis that there is not is the service's to refuse.
  std::string member = options.to ? "to" : "by";
  for (const Json& axis : part(*rig, "axes"))
    if (text(axis, "name") == options.axis && !text(axis, "unit").empty())
      member = fmt::format("{}_{}", member, text(axis, "unit"));
  const auto reply = client.post(
      "/v1/jog", {{"axis", options.axis}, {member, options.amount}, {"key", request_key()}});
  if (!reply) return complain(reply.error());
  const auto end = client.wait_for(reply->value("command", std::uint64_t{0}));
  if (!end) return complain(end.error());
  say(options.service.json ? json_text(Json{{"ok", true}, {"message", *end}}) : *end);
  return 0;
}

int steer(const ServiceOptions& options, const std::string& verb, const std::string& id) {
  const ServiceClient client(options);
  const auto session = session_or_current(client, id);
  if (!session) return complain(session.error());
  Ordered ordered = verb == "pause"  ? pausing
                    : verb == "halt" ? halting
                    : verb == "stop" ? stopping
                                     : resuming;
  if (verb == "stop") ordered.within = stop_time(client);
  const auto path = session_path(*session);
  if (!path) return complain(path.error());
  const auto reply = client.post(*path + "/" + verb, Json::object());
  if (!reply) return complain(reply.error());
  const auto end = wait_until(client, ordered);
  if (!end) return complain(end.error());
  say(options.json ? json_text(Json{{"ok", true}, {"state", *end}})
                   : fmt::format(fmt::runtime(ordered.done), *end));
  return 0;
}

int abort(const ServiceOptions& options, const std::string& reason) {
  Json body = Json::object();
  if (!reason.empty()) body["reason"] = reason;
  const ServiceClient client(options);
  const auto reply = client.post("/v1/abort", body);
  if (!reply) return complain(reply.error());
  // The answer says that every call was told to stop; what became of it is seen and not assumed.
  const auto end = wait_until(client, aborting);
  if (!end) return complain(end.error());
  const auto status = client.get_json("/v1/status");
  if (!status || status->value("lamp_may_be_on", true))
    return complain("aborted, but LAMP MAY BE ON: look, and switch it off by hand");
  say(options.json
          ? json_text(*reply)
          : "aborted: motion stopped, lamp dark, rig " + *end + ". This is no emergency stop");
  return 0;
}

int lock(const ServiceOptions& options, const std::string& note) {
  return finish(ServiceClient(options).post("/v1/lock", {{"note", note}}), options.json,
                "locked for " + options.as);
}

int unlock(const ServiceOptions& options, bool force) {
  return finish(ServiceClient(options).post("/v1/unlock", {{"force", force}}), options.json,
                "unlocked");
}

int sessions(const ServiceOptions& options) {
  const auto reply = ServiceClient(options).get_json("/v1/sessions");
  if (!reply) return complain(reply.error());
  if (options.json) {
    say(json_text(*reply));
    return 0;
  }
  std::vector<std::vector<std::string>> rows;
  for (const Json& one : reply->value("sessions", Json::array()))
    rows.push_back({text(one, "id"), standing(one, text(*reply, "root"))});
  say(table({"session in " + text(*reply, "root"), ""}, rows));
  return 0;
}

int log_level(const ServiceOptions& options, const std::string& level) {
  return finish(ServiceClient(options).post("/v1/log", {{"level", level}}), options.json,
                "log level " + level);
}

}  // namespace lightrig::cli
