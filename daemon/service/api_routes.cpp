// The operations of the control API, one line each, and what each does.
#include <fmt/format.h>
#include <unistd.h>

#include <charconv>
#include <cmath>
#include <nlohmann/json.hpp>
#include <numbers>

#include "config/json_text.h"
#include "daemon/service/api.h"
#include "daemon/service/api_body.h"
#include "daemon/service/status_json.h"

namespace lightrig {
namespace {

using Json = nlohmann::ordered_json;

HttpReply json_reply(int status, const Json& json) {
  return {status, json_text(json) + "\n", "application/json", {}};
}

// 202: taken on; what became of it stands in /v1/status under this number.
HttpAnswer accepted(const Result<std::uint64_t>& command) {
  if (!command) return error_reply(command.error());
  return json_reply(202, {{"command", *command}});
}

HttpAnswer agreed(const Result<void>& done) {
  if (!done) return error_reply(done.error());
  return json_reply(200, {{"ok", true}});
}

}  // namespace

std::vector<Route> Api::rig_routes() {
  using enum Route::Kind;
  return {
      {"GET",
       "/v1/status",
       "State of the rig, its devices and the session in hand",
       read,
       {},
       &Api::status},
      {"POST", "/v1/arm", "Open the devices and allow motion", mutation, {}, &Api::arm},
      {"POST", "/v1/disarm", "Give the devices back; nothing can move", mutation, {}, &Api::disarm},
      {"POST", "/v1/clear", "Put a fault, an abort or a result aside", mutation, {}, &Api::clear},
      {"POST", "/v1/home", "Home the gantry", mutation, {}, &Api::home},
      {"POST",
       "/v1/jog",
       "Move one axis by or to a value within its travel",
       mutation,
       {{"axis", "string", true, "name of the axis in the rig file"},
        {"by_deg", "number", false, "rotary axis: move by so many degrees"},
        {"to_deg", "number", false, "rotary axis: move to this angle"},
        {"by_mm", "number", false, "linear axis: move by so many millimetres"},
        {"to_mm", "number", false, "linear axis: move to this position"},
        {"by", "number", false, "choice among fixed lamps: so many lamps on"},
        {"to", "number", false, "choice among fixed lamps: this one, the first is 0"},
        {"key", "string", false, "requests repeated under one key move once"}},
       &Api::jog},
      {"POST",
       "/v1/lamp",
       "Set the lamp of an armed rig; it goes dark by itself after max_on_time_s",
       mutation,
       {{"power", "number", true, "0 to 1, at most the rig's max_power"},
        {"key", "string", false, "requests repeated under one key set it once"}},
       &Api::lamp},
      {"POST",
       "/v1/snap",
       "Take one frame for the preview, where the gantry stands",
       mutation,
       {{"exposure_s", "number", true, "seconds, within the sensor's range"},
        {"lamp", "boolean", false, "with the lamp lit and warm; dark afterwards"},
        {"key", "string", false, "requests repeated under one key take one frame"}},
       &Api::snap},
      {"GET",
       "/v1/rig",
       "The rig file, and what it lets the axes and the lamp do",
       read,
       {},
       &Api::rig},
      {"POST",
       "/v1/abort",
       "Stop whatever moves, lamp dark; always allowed",
       unlocked,
       {{"reason", "string", false, "why, for the record"}},
       &Api::abort},
      {"POST",
       "/v1/lock",
       "Reserve the rig under the name in X-Lightrig-Client",
       mutation,
       {{"note", "string", false, "why, for others to read"}},
       &Api::lock},
      {"POST",
       "/v1/unlock",
       "End the reservation",
       unlocked,
       {{"force", "boolean", false, "take it from whoever holds it"}},
       &Api::unlock},
  };
}

std::vector<Route> Api::session_routes() {
  using enum Route::Kind;
  return {
      {"GET",
       "/v1/sessions",
       "Sessions of the session root, newest first",
       read,
       {},
       &Api::list_sessions},
      {"POST",
       "/v1/sessions",
       "Start a session",
       mutation,
       {{"session_path", "string", false,
         "absolute path of a session file that the service can read; Unix socket only"},
        {"session_toml", "string", false, "text of a session file; paths in it absolute"},
        {"plan", "object", false, "a plan.json to follow; computed where none is given"},
        {"key", "string", false, "requests repeated under one key start one session"}},
       &Api::start,
       true},
      {"GET", "/v1/sessions/{id}", "What a session's folder holds", read, {}, &Api::session},
      {"GET", "/v1/sessions/{id}/plan", "plan.json of a session", read, {}, &Api::session_plan},
      {"GET",
       "/v1/sessions/{id}/result",
       "result.json of a session",
       read,
       {},
       &Api::session_result},
      {"POST",
       "/v1/sessions/{id}/pause",
       "Pause after the exposure in progress",
       mutation,
       {},
       &Api::pause},
      {"POST",
       "/v1/sessions/{id}/resume",
       "Go on, also after a restart",
       mutation,
       {},
       &Api::resume},
      {"POST",
       "/v1/sessions/{id}/stop",
       "End after this shot, then reduce",
       mutation,
       {},
       &Api::stop},
      {"POST",
       "/v1/sessions/{id}/halt",
       "End at once, lamp dark; paused, to be resumed",
       mutation,
       {},
       &Api::halt},
      {"POST",
       "/v1/sessions/{id}/retake",
       "Open a captured shot again; resuming takes it anew",
       mutation,
       {{"shot", "string", true, "name of the shot, as L03"}},
       &Api::retake},
      {"POST", "/v1/sessions/{id}/abort", "Same as /v1/abort", unlocked, {}, &Api::abort_session},
  };
}

std::vector<Route> Api::service_routes() {
  using enum Route::Kind;
  return {
      {"GET",
       "/v1/events",
       "Server-sent events; id is the journal's sequence",
       read,
       {},
       &Api::events},
      {"GET", "/v1/preview", "The last frame as PNG", read, {}, &Api::preview},
      {"GET", "/v1/log", "The last lines of the log", read, {}, &Api::recent_log},
      {"POST",
       "/v1/log",
       "Set the log level",
       mutation,
       {{"level", "string", true, "debug, info, warning or error"}},
       &Api::log_level},
      {"GET", "/v1/openapi.json", "This document", read, {}, &Api::openapi},
      {"GET", "/metrics", "Figures for Prometheus", read, {}, &Api::metrics},
      {"GET", "/", "The operator panel", page, {}, &Api::page},
  };
}

std::span<const Route> Api::routes() {
  static const std::vector<Route> routes = [] {
    std::vector<Route> all;
    for (const auto& part : {rig_routes(), session_routes(), service_routes()})
      all.insert(all.end(), part.begin(), part.end());
    return all;
  }();
  return routes;
}

HttpAnswer Api::status(const HttpRequest&, const std::string&) {
  return HttpReply{200, status_json(service_.snapshot()) + "\n", "application/json", {}};
}

HttpAnswer Api::arm(const HttpRequest& request, const std::string&) {
  return accepted(service_.arm(caller_of(request)));
}

HttpAnswer Api::disarm(const HttpRequest& request, const std::string&) {
  return accepted(service_.disarm(caller_of(request)));
}

HttpAnswer Api::clear(const HttpRequest& request, const std::string&) {
  return accepted(service_.clear(caller_of(request)));
}

HttpAnswer Api::home(const HttpRequest& request, const std::string&) {
  return accepted(service_.home(caller_of(request)));
}

HttpAnswer Api::jog(const HttpRequest& request, const std::string&) {
  const auto jog = jog_body(request.body, service_.rig().gantry.model.axes);
  if (!jog) return error_reply(jog.error());
  return accepted(service_.jog(caller_of(request), jog->axis, jog->value, jog->relative, jog->key));
}

HttpAnswer Api::lamp(const HttpRequest& request, const std::string&) {
  const auto lamp = lamp_body(request.body);
  if (!lamp) return error_reply(lamp.error());
  return accepted(service_.lamp(caller_of(request), lamp->power, lamp->key));
}

HttpAnswer Api::snap(const HttpRequest& request, const std::string&) {
  const SensorModel& sensor = service_.rig().camera.sensor;
  const auto snap = snap_body(request.body, sensor.min_exposure, sensor.max_exposure);
  if (!snap) return error_reply(snap.error());
  return accepted(service_.snap(caller_of(request), snap->exposure, snap->lit, snap->key));
}

HttpAnswer Api::rig(const HttpRequest&, const std::string&) {
  const Rig& rig = service_.rig();
  Json axes = Json::array();
  for (const Axis& axis : rig.gantry.model.axes) {
    const AxisUnit unit = unit_of(axis);
    axes.push_back({{"name", axis.name},
                    {"unit", unit.name},
                    {"min", axis.min * unit.per_si},
                    {"max", axis.max * unit.per_si},
                    {"home", axis.home * unit.per_si}});
  }
  Json interlocks = Json::array();
  for (const Interlock& interlock : rig.interlocks) interlocks.push_back(interlock.name);
  // What stops the drives when this process no longer speaks to them.
  Json watchdog = nullptr;
  if (const auto* modbus = std::get_if<ModbusGantry>(&rig.gantry.backend);
      modbus != nullptr && modbus->controller.watchdog && !service_.simulated())
    watchdog = std::chrono::duration<double>(modbus->controller.watchdog->timeout).count();
  return json_reply(
      200, {{"name", rig.name},
            {"process", getpid()},
            {"drive_watchdog_s", watchdog},
            {"file", rig.path.string()},
            {"text", rig.text},
            {"axes", std::move(axes)},
            {"lamp",
             {{"power", rig.lamp.power},
              {"max_power", rig.lamp.max_power},
              {"max_on_time_s", std::chrono::duration<double>(rig.lamp.max_on_time).count()}}},
            {"interlocks", std::move(interlocks)}});
}

HttpAnswer Api::abort(const HttpRequest& request, const std::string&) {
  const Caller caller = caller_of(request);
  // The stop came first, with the request's head; only now is it read what for. No more is read
  // than takes no time, and a reason that cannot be read is no reason less.
  if (!request.acted) service_.abort(caller, aborted_by(caller));
  const std::string reason = request.body.size() > abort_body
                                 ? std::string()
                                 : text_member(request.body, "reason").value_or("");
  if (!reason.empty()) service_.explain_abort(caller, aborted_by(caller), reason);
  return json_reply(200, {{"ok", true}, {"state", name_of(service_.snapshot().state)}});
}

HttpAnswer Api::abort_session(const HttpRequest& request, const std::string& id) {
  return abort(request, id);
}

HttpAnswer Api::lock(const HttpRequest& request, const std::string&) {
  return agreed(service_.lock(caller_of(request), text_member(request.body, "note").value_or("")));
}

HttpAnswer Api::unlock(const HttpRequest& request, const std::string&) {
  return agreed(service_.unlock(caller_of(request), flag_member(request.body, "force")));
}

HttpAnswer Api::steer(const HttpRequest& request, const std::string& id, SessionVerb verb) {
  // Of the session in hand at once, whatever hangs on a disk; resuming one that was given back
  // takes a look at its folder, and that may take a slow disk: not here.
  const auto now = service_.snapshot();
  if (now.session && now.session->id == id && (verb != SessionVerb::resume || now.busy)) {
    const auto done = service_.steer(caller_of(request), id, verb);
    return done ? json_reply(202, {{"ok", true}, {"command", *done}}) : error_reply(done.error());
  }
  return HttpLater{[this, caller = caller_of(request), id, verb]() -> HttpReply {
    const auto moment = service_.snapshot();
    if (!moment.session || moment.session->id != id)
      if (auto folder = session_folder_of(service_.rig().session_root, id); !folder)
        return error_reply(folder.error());
    const auto done = service_.steer(caller, id, verb);
    return done ? json_reply(202, {{"ok", true}, {"command", *done}}) : error_reply(done.error());
  }};
}

HttpAnswer Api::pause(const HttpRequest& request, const std::string& id) {
  return steer(request, id, SessionVerb::pause);
}

HttpAnswer Api::resume(const HttpRequest& request, const std::string& id) {
  return steer(request, id, SessionVerb::resume);
}

HttpAnswer Api::stop(const HttpRequest& request, const std::string& id) {
  return steer(request, id, SessionVerb::stop);
}

HttpAnswer Api::halt(const HttpRequest& request, const std::string& id) {
  return steer(request, id, SessionVerb::halt);
}

HttpAnswer Api::events(const HttpRequest& request, const std::string&) {
  HttpEvents events;
  const auto session = request.query.find("session");
  if (session != request.query.end()) events.session = session->second;
  std::string after = request.header("last-event-id");
  if (const auto asked = request.query.find("after"); asked != request.query.end())
    after = asked->second;
  const char* end = after.data() + after.size();
  const auto [last, error] = std::from_chars(after.data(), end, events.after);
  if (!after.empty() && (error != std::errc() || last != end))
    return error_reply(400, "invalid_input", "Last-Event-ID is a journal sequence: a number");
  return events;
}

HttpAnswer Api::preview(const HttpRequest&, const std::string&) {
  return HttpLater{[this]() -> HttpReply {
    auto png = service_.preview().png();
    if (!png) return error_reply(png.error());
    return {200, std::move(*png), "image/png", {}};
  }};
}

HttpAnswer Api::recent_log(const HttpRequest&, const std::string&) {
  return HttpReply{200, log_.recent(), "text/plain; charset=utf-8", {}};
}

HttpAnswer Api::log_level(const HttpRequest& request, const std::string&) {
  const auto name = text_member(request.body, "level");
  const auto level = name ? log_level_of(*name) : std::nullopt;
  if (!level)
    return error_reply(422, "invalid_input",
                       "\"level\" must be \"debug\", \"info\", \"warning\" or \"error\"");
  log_.set_level(*level);
  log_.info("log_level",
            {{"level", *name}, {"by", caller_of(request).name}, {"peer", request.peer}});
  return json_reply(200, {{"ok", true}});
}

HttpAnswer Api::metrics(const HttpRequest&, const std::string&) {
  return HttpReply{
      200, metrics_text(service_.snapshot(), hub_.readers()), "text/plain; version=0.0.4", {}};
}

HttpAnswer Api::openapi(const HttpRequest&, const std::string&) {
  return HttpReply{200, openapi_document(), "application/json", {}};
}

HttpAnswer Api::page(const HttpRequest& request, const std::string&) {
  if (!request.over_tcp)
    return error_reply(404, "not_found", "the panel is served over TCP alone (--listen)");
  auto page = panel_page();
  if (!page) return error_reply(page.error());
  return HttpReply{200,
                   std::move(*page),
                   "text/html; charset=utf-8",
                   {{"Content-Security-Policy",
                     "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; "
                     "img-src blob: data:; connect-src 'self'; frame-ancestors 'none'"},
                    {"Referrer-Policy", "no-referrer"}}};
}

}  // namespace lightrig
