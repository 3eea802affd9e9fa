// plan and dry-run: what a session will do, before anything moves.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include "cli/json_fields.h"
#include "cli/left_out.h"
#include "cli/plan_svg.h"
#include "cli/rig_files.h"
#include "cli/say.h"
#include "cli/verbs.h"
#include "config/json_text.h"
#include "daemon/session/capture_time.h"
#include "daemon/session/durable_file.h"
#include "daemon/session/plan_json.h"
#include "daemon/session/plan_shots.h"
#include "daemon/session/prepare.h"
#include "daemon/session/session_folder.h"

namespace lightrig::cli {
namespace {

// What the command line says goes before what the files say.
SessionSpec with_options(SessionSpec spec, const PlanOptions& options) {
  if (options.criterion == "condition") spec.plan.criterion = Criterion::condition;
  if (options.criterion == "a-optimal") spec.plan.criterion = Criterion::a_optimal;
  if (options.stop == "literal") spec.plan.stop = StopRule::literal;
  if (options.stop == "plateau") spec.plan.stop = StopRule::plateau;
  if (options.stop == "count") spec.plan.stop = StopRule::count;
  if (options.lights) {
    spec.plan.max_lights = *options.lights;
    // So many lights are wanted, not "at most, if the plateau does not come first".
    if (options.stop.empty()) spec.plan.stop = StopRule::count;
  }
  return spec;
}

std::string axis_value(const Axis& axis, double value) { return value_text(axis, value, 1); }

std::string light_table(const Rig& rig, const Prepared& prepared) {
  const Plan& plan = prepared.plan;
  std::vector<std::string> heads{"light", "visit"};
  for (const Axis& axis : rig.gantry.model.axes) heads.push_back(axis.name);
  for (const char* head : {"new cells", "rank", "κ²", "predicted error", "capture so far"})
    heads.emplace_back(head);
  std::vector<std::vector<std::string>> rows;
  for (std::size_t i = 0; i < plan.shots.size(); ++i) {
    const Shot& shot = plan.shots[i];
    const auto visit =
        std::find(plan.visit_order.begin(), plan.visit_order.end(), static_cast<int>(i));
    std::vector<std::string> row{
        shot_name(plan, static_cast<int>(i)),
        std::to_string(std::distance(plan.visit_order.begin(), visit) + 1)};
    for (std::size_t a = 0; a < rig.gantry.model.axes.size(); ++a)
      row.push_back(
          axis_value(rig.gantry.model.axes[a], shot.gantry.axes[static_cast<Eigen::Index>(a)]));
    if (shot.held_out) {
      for (const char* cell : {"–", "–", "–", "held out", "–"}) row.emplace_back(cell);
    } else {
      row.push_back(std::to_string(shot.selection.new_cells));
      row.push_back(std::to_string(shot.selection.rank));
      row.push_back(figure(shot.selection.condition));
      row.push_back(percent(shot.selection.predicted_error_percent));
      row.push_back(i < prepared.capture_by_lights.size() ? duration(prepared.capture_by_lights[i])
                                                          : "–");
    }
    rows.push_back(std::move(row));
  }
  return table(heads, rows);
}

std::string cost_table(const std::vector<StageCost>& cost) {
  std::vector<std::vector<std::string>> rows;
  double sum = 0;
  for (const StageCost& stage : cost) {
    rows.push_back({stage.stage, fmt::format("{:.3f}", stage.seconds)});
    sum += stage.seconds;
  }
  rows.push_back({"all", fmt::format("{:.3f}", sum)});
  return table({"stage", "seconds"}, rows);
}

// What was held out was asked for: its number is enough. Everything else is news.
std::string remark_words(const std::vector<std::string>& remarks) {
  std::string words;
  int held_out = 0;
  for (const std::string& remark : remarks) {
    if (remark.ends_with("held out, as asked"))
      ++held_out;
    else
      words += fmt::format("remark: {}\n", remark);
  }
  if (held_out > 0) words += fmt::format("remark: {} materials held out, as asked\n", held_out);
  return words;
}

std::string plan_words(const Rig& rig, const Prepared& prepared) {
  const Plan& plan = prepared.plan;
  const auto fitted = std::count_if(plan.shots.begin(), plan.shots.end(),
                                    [](const Shot& shot) { return !shot.held_out; });
  const char* criterion =
      plan.criterion == Criterion::condition ? "condition (κ² = λmax/λmin of GᵀG)" : "a-optimal";
  std::string words =
      fmt::format("object     {}\ncriterion  {}\n", prepared.object.description, criterion);
  words +=
      fmt::format("basis      {} components of {} materials ({}), {:.2f} % of their variance\n",
                  prepared.plan_basis.components(), prepared.plan_basis.materials,
                  prepared.plan_basis.source, 100 * prepared.plan_basis.variance_captured);
  words +=
      fmt::format("lights     {} of {} candidates, and {} held out; capture takes {}\n", fitted,
                  prepared.candidates.size(), plan.shots.size() - static_cast<std::size_t>(fitted),
                  duration(plan.predicted_capture_time));
  words += fmt::format("zero line  the mean material alone, no light at all: {}\n\n",
                       percent(plan.mean_only_error_percent));
  words +=
      light_table(rig, prepared) +
      "capture so far: what these lights and all before them take by the quickest way, held-out "
      "ones included\n\n";
  words += left_out_table(planned_left_out(prepared), plan.left_out.drivers_not_opened) + "\n" +
           cost_table(prepared.cost);
  words += fmt::format("peak memory {:.0f} MiB\n", prepared.peak_memory_mib);
  return words + remark_words(prepared.remarks);
}

}  // namespace

int plan(const PlanOptions& options) {
  const RigFiles files = read_rig_files(options.rig, options.session);
  show_diagnostics(files);
  if (!files.valid()) return 1;
  const Rig& rig = *files.rig.value;
  const SessionSpec spec = with_options(files.spec(), options);
  const auto prepared = prepare(rig, spec, options.brute_force);
  if (!prepared) return complain(with_context("plan", prepared.error()));
  const std::string json = plan_to_json(rig, spec, *prepared);
  if (!options.output.empty())
    if (auto written = write_durably(options.output, json); !written)
      return complain(with_context("write the plan", written.error()));
  if (!options.svg.empty()) {
    if (auto drawn = write_durably(options.svg, plan_svg(rig, *prepared)); !drawn)
      return complain(with_context("draw the plan", drawn.error()));
  }
  say(options.json ? json : plan_words(rig, *prepared));
  if (!options.output.empty() && !options.json) say("written to " + options.output);
  return 0;
}

namespace {

Json dry_run_json(const Rig& rig, const SessionSpec& spec, const Prepared& prepared,
                  const CaptureTime& time) {
  const Plan& plan = prepared.plan;
  const std::vector<double> predicted = predicted_on_the_way(prepared);
  Json steps = Json::array();
  for (std::size_t i = 0; i < time.shots.size(); ++i) {
    const ShotTime& step = time.shots[i];
    steps.push_back({{"shot", shot_name(plan, step.shot)},
                     {"move_s", step.move},
                     {"settle_s", step.settle},
                     {"warm_up_s", step.warm_up},
                     {"exposures_s", step.exposures},
                     {"total_s", step.total()},
                     {"predicted_error_percent", predicted[i]}});
  }
  Json axes = Json::array();
  const auto ranges = axis_ranges(rig.gantry.model, time);
  for (std::size_t a = 0; a < ranges.size(); ++a) {
    const Axis& axis = rig.gantry.model.axes[a];
    const AxisUnit unit = unit_of(axis);
    axes.push_back({{"axis", axis.name},
                    {"unit", unit.name},
                    {"least", ranges[a].least * unit.per_si},
                    {"most", ranges[a].most * unit.per_si},
                    {"travel_min", axis.min * unit.per_si},
                    {"travel_max", axis.max * unit.per_si}});
  }
  const SessionSize size = largest_session(rig, spec, plan);
  Json left_out = Json::object();
  for (const LeftOutLine& line : planned_left_out(prepared)) {
    Json one{{"what", line.what}, {"left_out", line.left_out}};
    if (line.of) one["of"] = *line.of;
    if (!line.why.empty()) one["why"] = line.why;
    left_out[line.name] = std::move(one);
  }
  return {{"dark_s", time.dark},
          {"steps", std::move(steps)},
          {"total_s", time.total()},
          {"axes", std::move(axes)},
          {"frames_at_most", size.frames},
          {"bytes_at_most", size.bytes},
          {"left_out", std::move(left_out)},
          {"remarks", prepared.remarks}};
}

std::string dry_run_words(const Rig& rig, const SessionSpec& spec, const Prepared& prepared,
                          const CaptureTime& time) {
  const Plan& plan = prepared.plan;
  const std::vector<double> predicted = predicted_on_the_way(prepared);
  std::vector<std::vector<std::string>> rows;
  const auto seconds = [](double value) { return fmt::format("{:.1f}", value); };
  double sum = time.dark;
  rows.push_back({"dark frames", "", "", "", seconds(time.dark), seconds(sum), ""});
  for (std::size_t i = 0; i < time.shots.size(); ++i) {
    const ShotTime& step = time.shots[i];
    const Shot& shot = plan.shots[static_cast<std::size_t>(step.shot)];
    sum += step.total();
    rows.push_back({shot_name(plan, step.shot), seconds(step.move), seconds(step.settle),
                    seconds(step.warm_up), seconds(step.exposures), seconds(sum),
                    shot.held_out ? "held out" : percent(predicted[i])});
  }
  std::string words =
      table({"step", "move s", "settle s", "warm-up s", "expose s", "elapsed s", "predicted error"},
            rows);
  words += "\n";
  rows.clear();
  const auto ranges = axis_ranges(rig.gantry.model, time);
  for (std::size_t a = 0; a < ranges.size(); ++a) {
    const Axis& axis = rig.gantry.model.axes[a];
    rows.push_back({axis.name, axis_value(axis, ranges[a].least), axis_value(axis, ranges[a].most),
                    axis_value(axis, axis.min), axis_value(axis, axis.max)});
  }
  words += table({"axis", "least", "most", "travel from", "to"}, rows);
  const SessionSize size = largest_session(rig, spec, plan);
  words += fmt::format(
      "\ntotal      {} without homing\nstorage    {} at most: {} frames, and the radiance of every "
      "light once it is reduced\n",
      duration(time.total()), bytes(size.bytes), size.frames);
  return words + "\n" +
         left_out_table(planned_left_out(prepared), plan.left_out.drivers_not_opened) +
         remark_words(prepared.remarks);
}

/// A plan as the service would plan it, or the stored one as the service would take it up.
Result<Prepared> rehearsed(const Rig& rig, const SessionSpec& spec, const std::string& stored) {
  if (stored.empty()) return prepare(rig, spec);
  const auto json = read_file(stored);
  if (!json) return tl::unexpected(with_context("read the plan", json.error()));
  const auto plan = plan_from_json(*json, stored);
  if (!plan) return tl::unexpected(plan.error());
  auto prepared = prepare_with_plan(rig, spec, *plan);
  if (!prepared) return prepared;
  if (auto same = check_made_for(*plan, *prepared); !same) return tl::unexpected(same.error());
  return prepared;
}

}  // namespace

int dry_run(const DryRunOptions& options) {
  const RigFiles files = read_rig_files(options.rig, options.session);
  show_diagnostics(files);
  if (!files.valid()) return 1;
  const Rig& rig = *files.rig.value;
  const SessionSpec spec = files.spec();
  const auto prepared = rehearsed(rig, spec, options.plan);
  if (!prepared) return complain(with_context("plan", prepared.error()));
  const CaptureTime time = capture_time(rig, spec, prepared->plan, &prepared->object.mesh);
  say(options.json ? json_text(dry_run_json(rig, spec, *prepared, time))
                   : dry_run_words(rig, spec, *prepared, time));
  return 0;
}

}  // namespace lightrig::cli
