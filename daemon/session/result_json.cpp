#include <cmath>
#include <nlohmann/json.hpp>

#include "config/json_text.h"
#include "daemon/session/exposures_told.h"
#include "daemon/session/session_result.h"
#include "daemon/session/session_story.h"

namespace lightrig {
namespace {

using Json = nlohmann::ordered_json;

// JSON has no infinity and no NaN: null says "no such number".
Json number(double value) { return std::isfinite(value) ? Json(value) : Json(nullptr); }

Json number(const std::optional<double>& value) { return value ? number(*value) : Json(nullptr); }

Json to_json(const CurvePoint& point) {
  return {{"lights", point.lights},
          {"elapsed_s", point.elapsed_s},
          {"predicted_error_percent", number(point.predicted_error_percent)},
          {"predicted_low_percent", number(point.predicted_low_percent)},
          {"predicted_high_percent", number(point.predicted_high_percent)},
          {"held_out_error_percent", number(point.held_out_error_percent)},
          {"true_error_percent", number(point.true_error_percent)}};
}

Json to_json(const BrdfError& error, const std::string& reference) {
  return {{"percent_log", number(error.percent_log)},
          {"percent_linear_cos", number(error.percent_linear_cos)},
          {"median_abs_log", number(error.median_abs_log)},
          {"cells", error.cells},
          {"reference", reference}};
}

Json to_json(const HeldOutError& held_out) {
  return {
      {"percent", number(held_out.percent)},
      {"seen_bins_percent", number(held_out.seen_percent)},
      {"rows", held_out.rows},
      {"measures",
       "misfit beyond noise at a light that was captured and not fitted, scaled to the table; not "
       "calibrated against the true error"}};
}

Json to_json(const Baselines& baselines) {
  Json json{{"mean_only",
             {{"percent", number(baselines.mean_only_percent)},
              {"against", baselines.mean_only_is_true ? "reference" : "prediction"}}},
            {"random_lights", nullptr}};
  if (const auto& random = baselines.random_lights) {
    json["random_lights"] = {{"pseudo_inverse_percent", number(random->pseudo_inverse_percent)},
                             {"pseudo_inverse_components", random->components},
                             {"map_percent", number(random->map_percent)},
                             {"lights", random->lights},
                             {"sets", random->sets}};
  }
  return json;
}

Json to_json(const ExtractionStatistics& s) {
  return {{"sites", s.sites},
          {"unlit", s.unlit},
          {"shadowed", s.shadowed},
          {"grazing", s.grazing},
          {"invalid_cell", s.invalid_cell},
          {"saturated", s.saturated},
          {"dark", s.dark},
          {"blocked", s.blocked}};
}

Json to_json(const LightResult& light) {
  const ExposuresTold exposures = exposures_told(light.shot);
  Json skipped = Json::array(), why = Json::array();
  for (const ExposuresTold::Skipped& one : exposures.skipped) {
    skipped.push_back(one.exposure);
    why.push_back(reason_of(one));
  }
  return {{"name", light.shot.name},
          {"held_out", light.shot.held_out},
          {light.light.distant ? "direction" : "position_m",
           {light.light.p.x(), light.light.p.y(), light.light.p.z()}},
          {"condition", light.condition > 0 ? number(light.condition) : Json(nullptr)},
          {"planned_error_percent",
           light.shot.held_out ? Json(nullptr) : number(light.predicted_error_percent)},
          {"exposures_s", exposures.used},
          {"exposures_skipped_s", skipped},
          {"exposures_skipped_why", why},
          {"rows_value", light.rows_value},
          {"rows_censored", light.rows_censored},
          {"new_cells", light.new_cells},
          {"misfit_percent", number(light.misfit_percent)},
          {"sites", to_json(light.statistics)}};
}

Json to_json(const std::vector<LeftOutLine>& lines, const std::vector<std::string>& drivers) {
  Json json = Json::object();
  for (const LeftOutLine& line : lines) {
    json[line.name] = {{"what", line.what},
                       {"left_out", line.left_out},
                       {"of", line.of ? Json(*line.of) : Json(nullptr)},
                       {"done", line.of ? Json(*line.of - line.left_out) : Json(nullptr)},
                       {"why", line.why}};
  }
  json["drivers_not_opened"] = drivers;
  return json;
}

Json to_json(const std::vector<ReplanNote>& notes) {
  Json list = Json::array();
  for (const ReplanNote& note : notes) {
    list.push_back({{"reason", note.reason},
                    {"lights", note.lights},
                    {"planned_error_percent", number(note.planned_percent)},
                    {"predicted_error_percent", number(note.percent)}});
  }
  return list;
}

Json method(const SessionResult& r) {
  return {{"estimator", r.estimator},
          {"criterion", describe(r.criterion)},
          {"mapping", r.mapping},
          {"floor_per_sr", r.floor},
          {"model_sigma", r.model_sigma},
          {"model_sigma_of_basis", r.expected_sigma},
          {"components", r.components},
          {"rank", r.coefficients.rank},
          {"basis",
           {{"source", r.basis_source},
            {"materials", r.basis_materials},
            {"variance_captured", r.variance_captured}}},
          {"rows_value", r.coefficients.rows_value},
          {"rows_censored", r.coefficients.rows_censored},
          {"residual_rms", number(r.coefficients.residual_rms)},
          {"clipped_cells", r.reconstruction.clipped_cells}};
}

Json to_json(const CalibrationMark& mark, const char* sigma) {
  if (!mark.given()) return nullptr;
  return {{"file", mark.file}, {"date", mark.date}, {"sha256", mark.sha256}, {sigma, mark.sigma}};
}

Json rows_of(const Eigen::MatrixXd& matrix) {
  Json rows = Json::array();
  for (Eigen::Index column = 0; column < matrix.cols(); ++column) {
    const Eigen::VectorXd values = matrix.col(column);
    rows.push_back(std::vector<double>(values.begin(), values.end()));
  }
  return rows;
}

}  // namespace

std::string scale_in_words(const SessionResult& result) {
  if (!result.absolute_scale) return "nominal: the rig file's lamp strength, not calibrated";
  return result.white.given() ? "absolute: by a white reference"
                              : "absolute, as the rig file states: no white reference was taken";
}

std::string result_json(const SessionResult& r) {
  Json json{{"schema", "lightrig.result/1"},
            {"session", r.session},
            {"rig", r.rig},
            {"sample_id", r.sample_id},
            {"operator", r.operator_name},
            {"notes", r.notes},
            {"object", r.object},
            {"state", r.state},
            {"scale", r.absolute_scale ? "absolute" : "nominal"},
            {"scale_by", scale_in_words(r)},
            {"white_reference", to_json(r.white, "relative_standard_error")},
            {"calibration", to_json(r.lens, "fx_standard_error_px")},
            {"unit", "1/sr"},
            {"stop", {{"planned", r.plan_stop}, {"fired", r.stop_fired}}},
            {"replanned", to_json(r.replans)},
            {"method", method(r)}};
  json["predicted_error_percent"] = number(r.reconstruction.predicted_error_percent);
  json["predicted_interval_90_percent"] = {number(r.reconstruction.predicted_low_percent),
                                           number(r.reconstruction.predicted_high_percent)};
  json["held_out"] = r.held_out ? to_json(*r.held_out) : Json(nullptr);
  json["error"] = r.true_error ? to_json(*r.true_error, r.reference) : Json(nullptr);
  json["baselines"] = to_json(r.baselines);
  json["curve"] = Json::array();
  for (const CurvePoint& point : r.curve) json["curve"].push_back(to_json(point));
  json["lights"] = Json::array();
  for (const LightResult& light : r.lights) json["lights"].push_back(to_json(light));
  json["left_out"] = to_json(r.left_out, r.drivers_not_opened);
  json["warnings"] = r.warnings;
  Json seconds = Json::object();
  for (const StageCost& stage : r.cost) {
    seconds[stage.stage] = seconds.value(stage.stage, 0.0) + stage.seconds;
  }
  Json capture = Json::object();
  for (const StageCost& stage : r.capture_cost) capture[stage.stage] = stage.seconds;
  json["cost"] = {{"threads", r.threads},
                  {"arithmetic", r.arithmetic},
                  {"capture_seconds", capture},
                  {"seconds", seconds}};
  return json_text(json, 2) + "\n";
}

std::string coefficients_json(const SessionResult& r) {
  Eigen::MatrixXd stddev(r.coefficients.c.rows(), r.coefficients.c.cols());
  for (Eigen::Index column = 0; column < stddev.cols(); ++column) {
    const auto block = static_cast<std::size_t>(column);
    stddev.col(column) =
        block < r.coefficients.covariance.size()
            ? Eigen::VectorXd(r.coefficients.covariance[block].diagonal().cwiseMax(0.0).cwiseSqrt())
            : Eigen::VectorXd::Zero(stddev.rows());
  }
  const Eigen::VectorXd& prior = r.basis->stddev;
  const bool stacked = r.basis->layout == ChannelLayout::stacked;
  const Json json{{"schema", "lightrig.coefficients/1"},
                  {"method", method(r)},
                  {"layout", stacked ? "stacked" : "columns"},
                  {"grid", {r.basis->grid.n_h, r.basis->grid.n_d}},
                  {"columns", stacked ? "all channels together" : "one per colour channel"},
                  {"c", rows_of(r.coefficients.c)},
                  {"stddev", rows_of(stddev)},
                  {"prior_stddev", std::vector<double>(prior.begin(), prior.end())}};
  return json_text(json, 1) + "\n";
}

}  // namespace lightrig
