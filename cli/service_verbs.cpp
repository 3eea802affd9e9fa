// The verbs that talk to the service of one rig.
#include <fmt/format.h>

#include <cmath>
#include <filesystem>
#include <numbers>

#include "cli/json_fields.h"
#include "cli/say.h"
#include "cli/service_client.h"
#include "cli/verbs.h"
#include "daemon/session/durable_file.h"

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
  say(json ? reply->dump() : done);
  return 0;
}

// Sends a command and waits until the rig has carried it out.
int carry_out(const ServiceOptions& options, const std::string& path, const Json& body) {
  const ServiceClient client(options);
  const auto reply = client.post(path, body);
  if (!reply) return complain(reply.error());
  const auto end = client.wait_for(reply->value("command", std::uint64_t{0}));
  if (!end) return complain(end.error());
  say(options.json ? Json{{"ok", true}, {"message", *end}}.dump() : *end);
  return 0;
}

}  // namespace

int status(const ServiceOptions& options) {
  const auto status = ServiceClient(options).get_json("/v1/status");
  if (!status) return complain(status.error());
  say(options.json ? status->dump() : status_words(*status));
  return 0;
}

int command(const ServiceOptions& options, const std::string& verb) {
  return carry_out(options, "/v1/" + verb, Json::object());
}

int jog(const JogOptions& options) {
  // Degrees or millimetres: the service knows the axis, so the unit is tried in its words.
  const char* rotary = options.to ? "to_deg" : "by_deg";
  const char* linear = options.to ? "to_mm" : "by_mm";
  const ServiceClient client(options.service);
  for (const char* unit : {rotary, linear}) {
    const auto reply = client.post("/v1/jog", {{"axis", options.axis}, {unit, options.amount}});
    const bool other_unit =
        !reply && reply.error().code == ErrorCode::invalid_input &&
        reply.error().message.find("takes exactly one number") != std::string::npos;
    if (other_unit && unit == rotary) continue;
    if (!reply) return complain(reply.error());
    const auto end = client.wait_for(reply->value("command", std::uint64_t{0}));
    if (!end) return complain(end.error());
    say(options.service.json ? Json{{"ok", true}, {"message", *end}}.dump() : *end);
    return 0;
  }
  return 1;
}

int steer(const ServiceOptions& options, const std::string& verb, const std::string& id) {
  const ServiceClient client(options);
  const auto session = session_or_current(client, id);
  if (!session) return complain(session.error());
  return finish(client.post("/v1/sessions/" + *session + "/" + verb, Json::object()), options.json,
                verb == "pause"  ? "pausing after the exposure in progress"
                : verb == "stop" ? "ending after this shot, then reducing"
                                 : "going on");
}

int abort(const ServiceOptions& options, const std::string& reason) {
  Json body = Json::object();
  if (!reason.empty()) body["reason"] = reason;
  return finish(ServiceClient(options).post("/v1/abort", body), options.json,
                "aborted: motion stopped, lamp dark, rig unarmed. This is no emergency stop");
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
    say(reply->dump());
    return 0;
  }
  std::vector<std::vector<std::string>> rows;
  for (const Json& one : reply->value("sessions", Json::array()))
    rows.push_back({text(one, "id"), one.value("result", false) ? "result" : "no result"});
  say(table({"session in " + text(*reply, "root"), ""}, rows));
  return 0;
}

int snap(const ServiceOptions& options, const std::string& output) {
  const auto png = ServiceClient(options).get("/v1/preview");
  if (!png) return complain(png.error());
  if (auto written = write_durably(output, *png); !written) return complain(written.error());
  say("last frame written to " + output);
  return 0;
}

int log_level(const ServiceOptions& options, const std::string& level) {
  return finish(ServiceClient(options).post("/v1/log", {{"level", level}}), options.json,
                "log level " + level);
}

}  // namespace lightrig::cli
