#include "daemon/service/status_json.h"

#include <fmt/format.h>

#include <cmath>
#include <nlohmann/json.hpp>

#include "config/json_text.h"

namespace lightrig {
namespace {

using Json = nlohmann::ordered_json;

std::string one_line(const Json& json) { return json_text(json); }

Json optional_number(const std::optional<double>& value) {
  return value && std::isfinite(*value) ? Json(*value) : Json(nullptr);
}

Json number(double value) { return optional_number(value); }

Json progress_of(const SessionProgress& progress) {
  const double total = progress.elapsed_s + progress.remaining_s;
  return {{"activity", progress.activity},
          {"shots_done", progress.shots_done},
          {"shots_total", progress.shots_total},
          {"percent", total > 0 ? number(100 * progress.elapsed_s / total) : Json(0)},
          {"elapsed_s", number(progress.elapsed_s)},
          {"remaining_s", number(progress.remaining_s)},
          {"predicted_error_percent", number(progress.predicted_error_percent)},
          {"held_out_error_percent", optional_number(progress.held_out_error_percent)},
          {"true_error_percent", optional_number(progress.true_error_percent)}};
}

Json session_of(const SessionView& session) {
  Json json{{"id", session.id},
            {"folder", session.folder.string()},
            {"state", session.state},
            {"reason", session.reason},
            {"paused_by", session.paused_by.empty() ? Json(nullptr) : Json(session.paused_by)},
            {"pause_requested", session.pause_requested},
            {"stop_requested", session.stop_requested}};
  json.update(progress_of(session.progress));
  Json curve = Json::array();
  for (const CurvePoint& entry : session.curve)
    curve.push_back({{"lights", entry.lights},
                     {"elapsed_s", number(entry.elapsed_s)},
                     {"predicted_error_percent", number(entry.predicted_error_percent)},
                     {"held_out_error_percent", optional_number(entry.held_out_error_percent)},
                     {"true_error_percent", optional_number(entry.true_error_percent)}});
  json["curve"] = std::move(curve);
  json["result"] = session.result.empty() ? Json(nullptr) : Json(session.result.string());
  return json;
}

Json facts_of(const RigFacts& facts) {
  Json axes = Json::array();
  for (Eigen::Index i = 0; i < facts.gantry.position.axes.size(); ++i)
    axes.push_back(number(facts.gantry.position.axes[i]));
  Json lamp = nullptr;
  if (facts.lamp)
    lamp = {{"power", number(facts.lamp->power)},
            {"confirmed", facts.lamp->confirmed},
            {"temperature_c", optional_number(facts.lamp->temperature_c)}};
  return {{"gantry",
           {{"position", std::move(axes)},
            {"homed", facts.gantry.homed},
            {"at_rest", facts.gantry.at_rest},
            {"alarm", facts.gantry.alarm},
            {"open_interlocks", facts.gantry.open_interlocks}}},
          {"lamp", std::move(lamp)},
          {"camera", facts.camera}};
}

}  // namespace

std::string status_json(const Snapshot& moment) {
  Json commands = Json::array();
  for (const CommandRecord& record : moment.commands)
    commands.push_back({{"id", record.id},
                        {"command", record.name},
                        {"state", record.state},
                        {"message", record.message}});
  Json self_test = Json::array();
  for (const DeviceLook& one : moment.self_test)
    self_test.push_back({{"device", one.device},
                         {"good", one.good},
                         {"said", one.said},
                         {"age_s", number(one.age_s)}});
  Json json{{"rig", moment.rig},
            {"simulated", moment.simulated},
            {"state", name_of(moment.state)},
            {"state_s", number(moment.state_s)},
            {"armed", is_armed(moment.state)},
            {"busy", moment.busy},
            {"ready", moment.why_not_ready.empty() && !moment.busy},
            {"why_not_ready", moment.why_not_ready},
            {"self_test", std::move(self_test)},
            {"lamp_may_be_on", moment.lamp_may_be_on},
            {"lock", nullptr},
            {"devices", moment.facts ? facts_of(*moment.facts) : Json(nullptr)},
            {"session", moment.session ? session_of(*moment.session) : Json(nullptr)},
            {"commands", std::move(commands)},
            {"disk_free_bytes", moment.disk_free_bytes},
            {"uptime_s", number(moment.uptime_s)}};
  if (moment.lock) json["lock"] = {{"name", moment.lock->name}, {"note", moment.lock->note}};
  return one_line(json);
}

std::string progress_json(const std::string& session, const SessionProgress& progress,
                          const std::optional<RigFacts>& facts) {
  Json json{{"session", session}};
  json.update(progress_of(progress));
  if (facts) json["devices"] = facts_of(*facts);
  return one_line(json);
}

std::string event_json(const std::string& session, const JournalEvent& event) {
  return one_line({{"session", session},
                   {"seq", event.sequence},
                   {"event", event.event},
                   {"fields", event.fields}});
}

std::string preview_json(const Preview::Facts& facts) {
  return one_line({{"shot", facts.shot},
                   {"exposure_s", facts.exposure},
                   {"saturated_percent", facts.saturated_percent},
                   {"histogram", facts.histogram}});
}

std::string metrics_text(const Snapshot& moment, std::size_t event_readers) {
  std::string text;
  const auto metric = [&](const char* name, const char* type, const char* help, double value) {
    text += fmt::format("# HELP lightrig_{0} {1}\n# TYPE lightrig_{0} {2}\nlightrig_{0} {3}\n",
                        name, help, type, value);
  };
  text +=
      "# HELP lightrig_state The service's state: 1 for the one it is in.\n"
      "# TYPE lightrig_state gauge\n";
  for (State state : all_states)
    text += fmt::format("lightrig_state{{state=\"{}\"}} {}\n", name_of(state),
                        state == moment.state ? 1 : 0);
  metric("uptime_seconds", "gauge", "Seconds since the service started.", moment.uptime_s);
  metric("ready", "gauge", "1 when a session could start now.",
         moment.why_not_ready.empty() && !moment.busy ? 1 : 0);
  metric("lamp_may_be_on", "gauge", "1 when the lamp could not be made dark.",
         moment.lamp_may_be_on ? 1 : 0);
  metric("disk_free_bytes", "gauge", "Free bytes on the disk of the session root.",
         static_cast<double>(moment.disk_free_bytes));
  metric("event_readers", "gauge", "Connected readers of events.",
         static_cast<double>(event_readers));
  metric("frames_total", "counter", "Frames stored.", static_cast<double>(moment.frames));
  metric("sessions_done_total", "counter", "Sessions ended with a result.",
         static_cast<double>(moment.sessions_done));
  metric("aborts_total", "counter", "ABORT requests.", static_cast<double>(moment.aborts));
  metric("faults_total", "counter", "Faults.", static_cast<double>(moment.faults));
  if (moment.session) {
    const SessionProgress& progress = moment.session->progress;
    metric("session_shots_done", "gauge", "Shots captured of the session in hand.",
           progress.shots_done);
    metric("session_shots", "gauge", "Shots planned of the session in hand.", progress.shots_total);
    metric("session_remaining_seconds", "gauge", "Predicted seconds left.", progress.remaining_s);
    metric("session_predicted_error_percent", "gauge", "Predicted error with the lights so far.",
           progress.predicted_error_percent);
  }
  return text;
}

}  // namespace lightrig
