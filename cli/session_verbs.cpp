// The verbs that work on a session's folder, with or without a service.
#include <fmt/format.h>

#include <filesystem>
#include <optional>
#include <thread>

#include "cli/json_fields.h"
#include "cli/left_out.h"
#include "cli/say.h"
#include "cli/service_client.h"
#include "cli/standing.h"
#include "cli/verbs.h"
#include "config/json_text.h"
#include "daemon/session/compare.h"
#include "daemon/session/durable_file.h"
#include "daemon/session/json_cursor.h"
#include "daemon/session/json_parse.h"
#include "daemon/session/reduction.h"
#include "daemon/session/session.h"

namespace lightrig::cli {
namespace {

int threads_of(int asked) {
  return asked > 0 ? asked : static_cast<int>(std::max(1U, std::thread::hardware_concurrency()));
}

std::string curve_table(const Json& curve) {
  std::vector<std::vector<std::string>> rows;
  for (const Json& point : curve)
    rows.push_back({fmt::format("{}", whole(point, "lights")), duration(number(point, "elapsed_s")),
                    percent(number(point, "predicted_error_percent")),
                    percent(number(point, "held_out_error_percent")),
                    percent(number(point, "true_error_percent"))});
  return table({"lights", "elapsed", "predicted error", "held-out light", "true error"}, rows) +
         "held-out light: misfit at a light that was not fitted; a check of pose and lamp, no "
         "estimate of the true error\n";
}

std::string baseline_words(const Json& baselines) {
  std::string words;
  const Json& mean = part(baselines, "mean_only");
  words += fmt::format("mean material alone, no light  {} ({})\n", percent(number(mean, "percent")),
                       text(mean, "against") == "reference" ? "true" : "predicted");
  const Json& random = part(baselines, "random_lights");
  if (random.is_object())
    words += fmt::format(
        "as many random lights          {} by MAP, {} by the published estimator (medians of {} "
        "sets, through the simulated camera)\n",
        percent(number(random, "map_percent")), percent(number(random, "pseudo_inverse_percent")),
        whole(random, "sets"));
  return words;
}

std::string left_out_words(const Json& left_out) {
  std::vector<LeftOutLine> lines;
  std::vector<std::string> drivers;
  for (const auto& [name, line] : left_out.items()) {
    if (name == "drivers_not_opened") {
      drivers = line.get<std::vector<std::string>>();
      continue;
    }
    const std::string what = text(line, "what");
    lines.push_back(
        {name, what.empty() ? name : what, whole(line, "left_out"), {}, text(line, "why")});
    if (part(line, "of").is_number_integer()) lines.back().of = whole(line, "of");
  }
  return left_out_table(lines, drivers);
}

std::string seconds_table(const std::string& title, const Json& seconds) {
  std::vector<std::vector<std::string>> rows;
  for (const auto& [stage, value] : seconds.items())
    if (value.is_number()) rows.push_back({stage, fmt::format("{:.3f}", value.get<double>())});
  return rows.empty() ? "" : table({title, "seconds"}, rows) + "\n";
}

std::string plan_costs(const std::filesystem::path& session) {
  const auto plan_text = read_file(session / "plan.json");
  if (!plan_text) return {};
  const auto plan = parse_json(*plan_text);
  if (!plan) return {};
  return seconds_table("planning", part(part(*plan, "cost"), "stages_s"));
}

std::string result_words(const std::filesystem::path& session, const Json& json) {
  std::string words = fmt::format("session {} of {}: {}\n\n", text(json, "session"),
                                  text(json, "object"), text(json, "state"));
  words += curve_table(part(json, "curve")) + "\n";
  const Json& interval = part(json, "predicted_interval_90_percent");
  words += fmt::format("predicted error                {}",
                       percent(number(json, "predicted_error_percent")));
  if (interval.is_array() && interval.size() == 2 && interval[0].is_number() &&
      interval[1].is_number())
    words += fmt::format(" (90 % within {} … {})", percent(interval[0].get<double>()),
                         percent(interval[1].get<double>()));
  const Json& error = part(json, "error");
  if (error.is_object())
    words += fmt::format("\ntrue error                     {} in ln f, {} linear cosine-weighted",
                         percent(number(error, "percent_log")),
                         percent(number(error, "percent_linear_cos")));
  words += fmt::format("\n{}\n", baseline_words(part(json, "baselines")));
  words += left_out_words(part(json, "left_out")) + "\n" + plan_costs(session) +
           seconds_table("on the rig", part(part(json, "cost"), "capture_seconds")) +
           seconds_table("stage", part(part(json, "cost"), "seconds"));
  for (const Json& warning : part(json, "warnings"))
    if (warning.is_string()) words += "warning: " + warning.get<std::string>() + "\n";
  const std::filesystem::path folder = session / "result";
  words += fmt::format("\nfiles   {}\nreport  {}\nBRDF    {}\n", session.string(),
                       (folder / "report.html").string(), (folder / "brdf.binary").string());
  return words;
}

// What result_words stands on; "" when all of it is there.
std::string problem_of_result(const Json& json) {
  std::string problem;
  const JsonCursor root(json, problem);
  if (root["schema"].text() != "lightrig.result/1")
    root["schema"].reject("is not lightrig.result/1");
  root["session"].text();
  root["state"].text();
  root["predicted_error_percent"].number_or_infinity();
  for (const JsonCursor& point : root["curve"].items()) {
    point["lights"].small_integer();
    point["elapsed_s"].number();
    point["predicted_error_percent"].number_or_infinity();
  }
  root["warnings"].texts();
  root["left_out"]["drivers_not_opened"].texts();
  root["cost"]["seconds"];
  return problem;
}

// What the service calls a session that is named here: what is no folder here is an id, and a
// folder in the service's root has one; whoever goes past the service goes past its lock and its
// log. Empty for any other folder, and where no service answers.
Result<std::optional<std::string>> id_at_service(const ServiceClient& client,
                                                 const std::string& session) {
  std::error_code error;
  if (!std::filesystem::exists(SessionFolder{session}.journal(), error)) return session;
  const auto list = client.get_json("/v1/sessions");
  if (!list && list.error().code == ErrorCode::disconnected) return std::nullopt;
  if (!list) return tl::unexpected(list.error());
  const auto folder = std::filesystem::canonical(session, error);
  if (error || !std::filesystem::equivalent(folder.parent_path(), text(*list, "root"), error) ||
      !session_path(folder.filename().string()))  // none that the service takes for a session
    return std::nullopt;
  return folder.filename().string();
}

Result<void> retake_at_service(const ServiceClient& client, const std::string& session,
                               const std::string& shot) {
  const auto path = session_path(session);
  const auto done = path ? client.post(*path + "/retake", {{"shot", shot}})
                         : Result<Json>(tl::unexpected(path.error()));
  if (done) return {};
  const auto is_missing = [](const Error& error) { return error.code == ErrorCode::not_found; };
  // Where it is the shot that is not there, the service knows the session.
  if (!is_missing(done.error())) return tl::unexpected(done.error());
  if (path) {
    const auto known = client.get_json(*path);
    if (known || !is_missing(known.error())) return tl::unexpected(done.error());
  }
  return tl::unexpected(
      with_context(fmt::format("retake {}: there is no session folder {} here, and of the service",
                               shot, session),
                   done.error()));
}

}  // namespace

int result(const std::string& session, bool json) {
  const std::filesystem::path path = std::filesystem::path(session) / "result" / "result.json";
  const auto file = read_file(path);
  if (!file)
    return complain(fmt::format("{} has no result ({}); lightrig reduce {} computes it", session,
                                file.error().message, session));
  const auto parsed = parse_json(*file);
  const std::string problem = parsed ? problem_of_result(*parsed) : parsed.error().message;
  if (!problem.empty())
    return complain(fmt::format("{} is damaged: {}; lightrig reduce {} computes it anew",
                                path.string(), problem, session));
  const std::string open = open_words(session);
  const std::string before = "the result is from before a light was taken back: " + open;
  if (json && !open.empty()) complain(before);  // beside the file, which is given as it stands
  say(json ? *file : (open.empty() ? "" : before + "\n\n") + result_words(session, *parsed));
  return 0;
}

int reduce(const ReduceOptions& options) {
  if (!options.environment.empty() && options.output.empty())
    return complain(
        "--environment needs -o: a session folder's own report keeps the light that `verify` draws "
        "it with");
  const auto summary = reduce_session(options.session, options.output, threads_of(options.threads),
                                      options.environment);
  if (!summary) return complain(with_context("reduce " + options.session, summary.error()));
  if (options.json) {
    Json json{{"result", summary->result.string()},
              {"mean_only_error_percent", summary->mean_only_error_percent}};
    if (!summary->curve.empty())
      json["predicted_error_percent"] = summary->curve.back().predicted_error_percent;
    if (summary->has_truth) json["true_error_percent"] = summary->true_error.percent_log;
    say(json_text(json));
    return 0;
  }
  std::vector<std::vector<std::string>> rows;
  for (const StageCost& stage : summary->cost)
    rows.push_back({stage.stage, fmt::format("{:.3f}", stage.seconds)});
  say(table({"stage", "seconds"}, rows));
  if (!summary->curve.empty())
    say("predicted error " + percent(summary->curve.back().predicted_error_percent));
  if (summary->has_truth) say("true error      " + percent(summary->true_error.percent_log));
  say("result in " + summary->result.string());
  return 0;
}

int verify(const ReduceOptions& options) {
  auto report = verify_session(options.session, threads_of(options.threads));
  if (!report) return complain(with_context("verify " + options.session, report.error()));
  // The one finding that explains the others.
  if (const std::string open = open_words(options.session); !report->sound && !open.empty())
    report->findings.insert(
        report->findings.begin(),
        "the result is from before a light was taken back, so that what follows "
        "differs: " +
            open);
  if (options.json) {
    say(json_text(Json{
        {"sound", report->sound}, {"findings", report->findings}, {"summary", report->summary}}));
    return report->sound ? 0 : 1;
  }
  for (const std::string& finding : report->findings) complain(finding);
  say(report->summary);
  return report->sound ? 0 : 1;
}

int retake(const ServiceOptions& options, const std::string& session, const std::string& shot) {
  const auto id = id_at_service(ServiceClient(options), session);
  if (!id) return complain(with_context("retake " + shot, id.error()));
  if (auto done = *id ? retake_at_service(ServiceClient(options), **id, shot)
                      : retake_shot(SessionFolder{session}, shot);
      !done)
    return complain(done.error());
  if (options.json) {
    say(json_text(Json{{"ok", true}, {"session", session}, {"shot", shot}}));
    return 0;
  }
  say(fmt::format(
      "{} is open again; its frames are kept in rejected/. lightrig resume takes it anew", shot));
  return 0;
}

int compare(const CompareOptions& options) {
  const auto a = load_brdf(options.a);
  if (!a) return complain(a.error());
  const auto b = load_brdf(options.b);
  if (!b) return complain(b.error());
  const auto comparison = lightrig::compare(*a, *b, options.floor, threads_of(0));
  if (!comparison) return complain(with_context("compare", comparison.error()));
  const BrdfError& error = comparison->error;
  if (!options.picture.empty())
    if (auto written = write_durably(options.picture, comparison->png); !written)
      return complain(with_context("write the picture", written.error()));
  if (options.json) {
    say(json_text(Json{{"percent_log", error.percent_log},
                       {"percent_linear_cos", error.percent_linear_cos},
                       {"median_abs_log", error.median_abs_log},
                       {"cells", error.cells},
                       {"mean_ratio", comparison->mean_ratio},
                       {"percent_log_scaled", comparison->percent_log_scaled}}));
    return 0;
  }
  say(table(
      {fmt::format("{} against {}", options.a, options.b), ""},
      {{"error in ln f, floor " + figure(options.floor) + " 1/sr", percent(error.percent_log)},
       {"the same after one common factor", percent(comparison->percent_log_scaled)},
       {"that factor", figure(comparison->mean_ratio)},
       {"linear, cosine-weighted", percent(error.percent_linear_cos)},
       {"median |ln a − ln b|", figure(error.median_abs_log)},
       {"cells compared", std::to_string(error.cells)}}));
  if (!options.picture.empty()) say("picture in " + options.picture);
  return 0;
}

int export_merl(const std::string& session, const std::string& output) {
  if (auto done = lightrig::export_merl(session, output); !done)
    return complain(with_context("export", done.error()));
  say("written to " + output);
  return 0;
}

}  // namespace lightrig::cli
