#include <fmt/format.h>

#include <Eigen/Core>
#include <algorithm>
#include <system_error>

#include "daemon/session/baselines.h"
#include "daemon/session/durable_file.h"
#include "daemon/session/frame_file.h"
#include "daemon/session/held_out.h"
#include "daemon/session/manifest.h"
#include "daemon/session/picture_file.h"
#include "daemon/session/reduction.h"
#include "daemon/session/report.h"
#include "daemon/session/result_pictures.h"
#include "daemon/session/session_result.h"
#include "daemon/session/session_story.h"
#include "daemon/session/session_upkeep.h"
#include "daemon/session/stopwatch.h"
#include "sim/open_devices.h"
#include "sim/truth.h"

namespace lightrig {
namespace {

namespace fs = std::filesystem;

// Each light of a set is a picture: more sets would cost a demo its minute.
constexpr int random_sets = 5;

std::string arithmetic(int threads) {
  return fmt::format(
      "Linear algebra: Eigen {}.{}.{}'s own kernels, no external BLAS. Times are wall clock with "
      "{} "
      "thread{}, reading and writing files included where the stage says so.",
      EIGEN_WORLD_VERSION, EIGEN_MAJOR_VERSION, EIGEN_MINOR_VERSION, threads,
      threads == 1 ? "" : "s");
}

// Held-out shots first, so that every point of the curve can be compared with them; the others in
// the order of capture.
std::vector<CapturedShot> reduction_order(const std::vector<CapturedShot>& shots) {
  std::vector<CapturedShot> order = shots;
  std::stable_partition(order.begin(), order.end(),
                        [](const CapturedShot& shot) { return shot.held_out; });
  return order;
}

Result<void> go_on(const std::stop_token& stop) {
  if (stop.stop_requested()) return fail(ErrorCode::stopped, "reduce: stopped on request");
  return {};
}

Result<std::vector<CurvePoint>> reduce_shots(const SessionRecord& record, Reduction& reduction,
                                             const std::stop_token& stop,
                                             const std::function<void(const CurvePoint&)>& told) {
  std::vector<CurvePoint> curve;
  for (const CapturedShot& shot : reduction_order(record.shots)) {
    if (auto next = go_on(stop); !next) return tl::unexpected(next.error());
    if (auto added = reduction.add(shot); !added) return tl::unexpected(added.error());
    if (!shot.held_out) curve.push_back(reduction.estimate());
    if (reduction.trouble()) return tl::unexpected(*reduction.trouble());
    if (told && !shot.held_out) told(curve.back());
  }
  if (curve.empty()) {
    return fail(ErrorCode::invalid_input,
                fmt::format("reduce '{}': it holds no light that may be fitted ({} captured, state "
                            "'{}'): capture at least one",
                            record.folder.root.string(), record.shots.size(), record.state));
  }
  return curve;
}

Baselines baselines_of(const SessionRecord& record, const Prepared& prepared,
                       const Reduction& reduction, const std::optional<Reference>& reference,
                       const RandomLightsOptions& options, std::vector<StageCost>& cost) {
  Baselines baselines;
  if (!reference) {
    baselines.mean_only_percent = record.plan.mean_only_error_percent;
    return baselines;
  }
  const Stopwatch watch("baselines", cost);
  baselines.mean_only_is_true = true;
  baselines.mean_only_percent = mean_only_error(reduction.basis(), reference->table);
  if (record.spec.plan.random_baseline && prepared.bins.candidates() > 0) {
    const auto simulated_truth =
        reference->simulated ? sim::truth_of(record.rig) : Result<Reflectance>();
    const Reflectance truth = reference->simulated && simulated_truth
                                  ? *simulated_truth
                                  : sim::interpolated(to_merl(reference->table, 1));
    baselines.random_lights =
        random_lights(record.rig, record.spec, prepared, truth, reference->table, options);
  }
  return baselines;
}

void describe_session(const SessionRecord& record, const Reduction& reduction, int threads,
                      SessionResult& r) {
  const BrdfBasis& basis = reduction.basis();
  r.session = record.id;
  r.rig = record.rig.name;
  r.sample_id = record.spec.sample_id;
  r.operator_name = record.spec.operator_name;
  r.notes = record.spec.notes;
  r.state = record.state;
  r.estimator = describe(record.spec.estimator, basis.components());
  r.mapping = describe(basis.mapping);
  r.basis_source = basis.source;
  r.criterion = record.plan.criterion;
  r.plan_stop = describe(record.plan);
  r.stop_fired = stop_fired(record);
  r.capture_cost = capture_cost(record);
  r.replans = replans_of(record);
  r.arithmetic = arithmetic(threads);
  r.floor = basis.mapping.floor;
  r.model_sigma = basis.model_sigma;
  r.expected_sigma = reduction.expected_sigma();
  r.variance_captured = basis.variance_captured;
  r.basis_materials = basis.materials;
  r.components = static_cast<int>(basis.components());
  r.channels = record.rig.camera.sensor.channels();
  r.absolute_scale = record.rig.lamp.absolute_scale;
  r.white = record.rig.lamp.white_mark;
  r.lens = record.rig.camera.calibration_mark;
  r.threads = threads;
  r.drivers_not_opened = record.plan.left_out.drivers_not_opened;
}

Result<void> write_uncertainty(const fs::path& folder, const Reconstruction& fit) {
  const auto channels = static_cast<std::size_t>(fit.log_stddev.cols());
  const std::vector<std::string> names =
      channels == 3 ? std::vector<std::string>{"R", "G", "B"} : std::vector<std::string>{"Y"};
  std::vector<float> pixels;
  for (Eigen::Index cell = 0; cell < fit.log_stddev.rows(); ++cell) {
    for (Eigen::Index c = 0; c < fit.log_stddev.cols(); ++c) {
      pixels.push_back(static_cast<float>(fit.log_stddev(cell, c)));
    }
  }
  const auto bytes = encode_float_exr(fit.brdf.grid.n_d, fit.brdf.grid.n_h, names, pixels);
  if (!bytes) return tl::unexpected(bytes.error());
  return write_durably(folder / "uncertainty.exr", *bytes);
}

Result<void> write_pictures(const fs::path& folder, const ResultPictures& pictures) {
  std::vector<const StoredPicture*> all{&pictures.spheres, &pictures.table,
                                        &pictures.table_difference, &pictures.uncertainty,
                                        &pictures.coverage};
  for (const ResultPictures::Light& light : pictures.lights) {
    all.push_back(&light.images);
    all.push_back(&light.bins);
  }
  for (const StoredPicture* picture : all) {
    if (!picture->shown()) continue;
    if (auto written = write_durably(folder / picture->file, picture->png); !written) {
      return written;
    }
  }
  return {};
}

Result<void> write_result(const fs::path& folder, const SessionResult& result,
                          const ResultPictures& pictures) {
  if (auto made = make_folder(folder); !made) return made;
  const BrdfTable& brdf = result.reconstruction.brdf;
  if (auto r = write_durably(folder / "brdf.binary", encode_merl(to_merl(brdf, 1))); !r) return r;
  if (auto r = write_uncertainty(folder, result.reconstruction); !r) return r;
  if (auto r = write_durably(folder / "coefficients.json", coefficients_json(result)); !r) return r;
  if (auto r = write_pictures(folder, pictures); !r) return r;
  if (auto r = write_durably(folder / "report.html", report_html(result, pictures)); !r) return r;
  // Last: whoever sees result.json sees a whole result.
  return write_durably(folder / "result.json", result_json(result));
}

ReductionSummary summary_of(const SessionResult& result, const fs::path& folder) {
  ReductionSummary summary;
  summary.curve = result.curve;
  if (result.true_error) summary.true_error = *result.true_error;
  summary.has_truth = result.true_error.has_value();
  summary.mean_only_error_percent = result.baselines.mean_only_percent;
  if (const auto& random = result.baselines.random_lights) {
    summary.random_lights_error_percent = random->pseudo_inverse_percent;
    summary.random_lights_map_error_percent = random->map_percent;
  }
  summary.cost = result.cost;
  summary.result = folder;
  return summary;
}

}  // namespace

Result<ReductionSummary> reduce_session(const fs::path& session, const fs::path& out, int threads,
                                        const fs::path& environment, const Patience& patience,
                                        const std::function<void(const CurvePoint&)>& told) {
  const std::stop_token& stop = patience.stop;
  const Result<Environment> surroundings = environment.empty()
                                               ? Result<Environment>(studio_environment())
                                               : read_environment(environment);
  if (!surroundings) return tl::unexpected(surroundings.error());
  const auto record = read_session_folder(session);
  if (!record) return tl::unexpected(record.error());
  std::error_code ignored;
  const bool in_place = out.empty() || fs::equivalent(out, record->folder.root, ignored);
  // Two that write one result would leave a mixture of both.
  const auto held =
      in_place ? hold_folder(record->folder) : Result<FileDescriptor>(FileDescriptor());
  if (!held) return tl::unexpected(held.error());
  const auto prepared = prepare_with_plan(record->rig, record->spec, record->plan, patience);
  if (!prepared) return tl::unexpected(prepared.error());
  auto reference = reference_of(record->rig, record->spec, simulated(*record));
  if (!reference) return tl::unexpected(reference.error());
  const fs::path root = out.empty() ? record->folder.root : out;
  const fs::path radiance = root / "radiance";
  if (auto made = make_folder(radiance); !made) return tl::unexpected(made.error());

  Reduction reduction(record->rig, record->spec, *prepared, record->folder, record->darks,
                      ReductionOptions{threads, *reference, radiance, true, patience});
  auto curve = reduce_shots(*record, reduction, stop, told);
  if (!curve) return tl::unexpected(curve.error());

  if (auto next = go_on(stop); !next) return tl::unexpected(next.error());
  SessionResult result;
  describe_session(*record, reduction, threads, result);
  result.object = prepared->object.description;
  result.curve = std::move(*curve);
  result.basis = &reduction.basis();
  result.coefficients = reduction.coefficients();
  result.reconstruction = reduction.reconstruction();
  std::vector<BrdfObservations> held_out;
  for (std::size_t i = 0; i < reduction.shots().size(); ++i) {
    if (reduction.shots()[i].shot.held_out) held_out.push_back(reduction.observations()[i]);
  }
  if (!held_out.empty()) {
    result.held_out = held_out_error(held_out, result.reconstruction, result.floor);
  }
  if (*reference) {
    result.true_error = brdf_error(result.reconstruction.brdf, (*reference)->table, result.floor);
    result.reference = (*reference)->name;
  }
  result.cost = prepared->cost;
  std::vector<StageCost> after;
  result.baselines = baselines_of(
      *record, *prepared, reduction, *reference,
      {result.curve.back().lights, random_sets, record->spec.plan.seed, threads, patience}, after);
  result.lights = light_results(reduction, record->plan);
  result.left_out = left_out_lines(*record, *prepared, reduction.basis());
  result.warnings = warnings_of(*record, *prepared, result);
  if (auto next = go_on(stop); !next) return tl::unexpected(next.error());
  Stopwatch drawing("pictures", after);
  const auto pictures =
      draw_pictures(reduction, *prepared->occluder, *reference ? &(*reference)->table : nullptr,
                    *surroundings, threads, patience);
  drawing.stop();
  if (!pictures) return tl::unexpected(pictures.error());
  for (const std::vector<StageCost>& part : {reduction.cost(), after}) {
    result.cost.insert(result.cost.end(), part.begin(), part.end());
  }
  const fs::path folder = root / "result";
  if (auto next = go_on(stop); !next) return tl::unexpected(next.error());
  if (auto written = write_result(folder, result, *pictures); !written) {
    return tl::unexpected(with_context("write the result", written.error()));
  }
  if (in_place) {
    if (auto renewed = renew_results_in_manifest(record->folder, patience); !renewed) {
      return tl::unexpected(with_context("keep the seal", renewed.error()));
    }
  }
  return summary_of(result, folder);
}

}  // namespace lightrig
