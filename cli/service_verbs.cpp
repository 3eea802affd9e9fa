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
#include "cli/rig_files.h"
#include "cli/say.h"
#include "cli/service_client.h"
#include "cli/verbs.h"
#include "config/json_text.h"
#include "daemon/session/durable_file.h"
#include "daemon/session/pose_check.h"
#include "daemon/session/pose_overlay.h"
#include "daemon/session/session_folder.h"

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

// How a session of the list stands, and what goes on with it.
std::string standing(const Json& one, const std::string& root) {
  const std::string state = text(one, "state"), id = text(one, "id");
  if (one.value("result", false)) return "result";
  if (state == "done") return fmt::format("captured, no result; lightrig resume {}", id);
  if (state == "damaged") return fmt::format("damaged; lightrig verify {}/{}", root, id);
  if (state.empty()) return "no result";
  const std::string so_far = fmt::format("{} after {} of {} lights", state,
                                         whole(one, "shots_done"), whole(one, "shots_planned"));
  return state == "capturing" || state == "reducing"
             ? so_far
             : fmt::format("{}; lightrig resume {}", so_far, id);
}

// The newest session where it waits for somebody to go on with it: after a crash nothing else says
// that one was under way.
std::string unfinished_words(const ServiceClient& client) {
  const auto reply = client.get_json("/v1/sessions");
  if (!reply || part(*reply, "sessions").empty()) return {};
  const Json& newest = part(*reply, "sessions").front();
  const std::string state = text(newest, "state");
  if (newest.value("result", false) || (state != "interrupted" && state != "paused")) return {};
  return fmt::format("unfinished {}: {}\n", text(newest, "id"),
                     standing(newest, text(*reply, "root")));
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
                       [](const Json& s) { return at_rest(s) && part(s, "devices").is_null(); },
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
  say(status_words(*status) +
      (part(*status, "session").is_object() ? "" : unfinished_words(client)));
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
  const auto reply = client.post("/v1/sessions/" + *session + "/" + verb, Json::object());
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

/// Where the service says that the gantry stands; empty where it does not know.
Result<std::optional<GantryPosition>> gantry_position(const ServiceClient& client, const Rig& rig) {
  const auto status = client.get_json("/v1/status");
  if (!status) return tl::unexpected(status.error());
  const Json at = part(part(part(*status, "devices"), "gantry"), "position");
  if (at.size() != rig.gantry.model.axes.size()) return std::optional<GantryPosition>();
  GantryPosition position;
  position.axes.resize(static_cast<Eigen::Index>(at.size()));
  for (std::size_t i = 0; i < at.size(); ++i) {
    if (!at[i].is_number()) return std::optional<GantryPosition>();
    position.axes[static_cast<Eigen::Index>(i)] = at[i].get<double>();
  }
  return std::optional<GantryPosition>(position);
}

/// How the object lies in a frame that was just taken with the lamp, in words.
std::string pose_line(const std::string& png, const Rig& rig, const Prepared& prepared,
                      const std::optional<GantryPosition>& at, bool just_lit) {
  if (!just_lit)
    return "whether the object lies as modelled is told of a frame taken with the lamp: add "
           "--exposure S --lamp";
  if (!at) return "pose: the gantry's position is not known";
  const auto pose = pose_in_preview(png, rig, prepared, *at);
  if (!pose) return "pose: " + pose.error().message;
  if (!pose->told) return "pose: not told, too little of the object is seen or lit";
  return (wrong(*pose) ? "POSE: " + pose_reason(*pose, false)
                       : std::string("pose: as modelled") +
                             (pose->motions_seen() < 6 ? " as far as can be seen, " : ", ") +
                             in_words(*pose));
}

/// Planned lights whose highlight is not drawn, and why; "" where all are.
std::string not_drawn(const Plan& plan, const ExpectedHighlights& highlights) {
  std::string words;
  const auto add = [&](const std::vector<int>& shots, const char* why) {
    std::vector<std::string> names;
    for (const int shot : shots) names.push_back(shot_name(plan, shot));
    if (!names.empty()) words += fmt::format("not drawn: {}: {}\n", fmt::join(names, ", "), why);
  };
  add(highlights.at_another_turn, "planned at another turn of the object than it stands at now");
  add(highlights.lights_nothing, "lights nothing that the camera sees");
  return words;
}

int snap(const SnapOptions& options) {
  const ServiceClient client(options.service);
  if (options.exposure > 0) {
    const auto reply =
        client.post("/v1/snap", {{"exposure_s", options.exposure}, {"lamp", options.lamp}});
    if (!reply) return complain(reply.error());
    if (auto end = client.wait_for(reply->value("command", std::uint64_t{0})); !end)
      return complain(end.error());
  }
  const auto png = client.get("/v1/preview");
  if (!png) return complain(png.error());
  if (!options.overlay) {
    if (auto written = write_durably(options.output, *png); !written)
      return complain(written.error());
    return finish(
        Json{{"ok", true}, {"file", options.output}}, options.service.json,
        (options.exposure > 0 ? "frame written to " : "last frame written to ") + options.output);
  }
  if (options.rig.empty())
    return complain("--overlay draws what the rig file models over the frame: name it with --rig");
  const RigFiles files = read_rig_files(options.rig, options.session);
  show_diagnostics(files);
  if (!files.valid()) return 1;
  const auto prepared = prepare(*files.rig.value, files.spec());
  if (!prepared) return complain(with_context("plan", prepared.error()));
  const Rig& rig = *files.rig.value;
  const auto at = gantry_position(client, rig);
  if (!at) return complain(at.error());
  const GantryPosition stands = at->value_or(home_position(rig.gantry.model));
  const auto drawn = overlay_png(*png, rig, *prepared, stands);
  if (!drawn) return complain(drawn.error());
  if (auto written = write_durably(options.output, *drawn); !written)
    return complain(written.error());
  const ExpectedHighlights highlights = expected_highlights(rig, *prepared, stands);
  std::vector<std::vector<std::string>> rows;
  for (const ExpectedHighlight& one : highlights.seen)
    rows.push_back({shot_name(prepared->plan, one.shot),
                    fmt::format("{:.0f}, {:.0f}", one.pixel.x(), one.pixel.y()),
                    fmt::format("{:.1f}°", one.off * 180 / std::numbers::pi)});
  if (options.service.json) {
    Json lights = Json::array();
    for (const ExpectedHighlight& one : highlights.seen)
      lights.push_back({{"light", shot_name(prepared->plan, one.shot)},
                        {"column", one.pixel.x()},
                        {"row", one.pixel.y()}});
    say(json_text(Json{{"ok", true}, {"file", options.output}, {"highlights", std::move(lights)}}));
    return 0;
  }
  std::string words =
      table({"light", "highlight at column, row", "from the mirror direction"}, rows) +
      not_drawn(prepared->plan, highlights);
  if (!*at) words += "the gantry's position is not known: drawn as at home\n";
  say(words + pose_line(*png, rig, *prepared, *at, options.exposure > 0 && options.lamp) +
      "\nlast frame with the model's outline (green) and highlights (rings) written to " +
      options.output);
  return 0;
}

int log_level(const ServiceOptions& options, const std::string& level) {
  return finish(ServiceClient(options).post("/v1/log", {{"level", level}}), options.json,
                "log level " + level);
}

}  // namespace lightrig::cli
