#include "daemon/session/session_story.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <set>
#include <variant>

#include "daemon/session/black_pixels.h"
#include "daemon/session/held_out.h"
#include "daemon/session/pose_check.h"

namespace lightrig {
namespace {

std::int64_t used_exposures(const CapturedShot& shot) {
  return std::count_if(shot.frames.begin(), shot.frames.end(), [](const StoredFrame& f) {
    return f.role == "bracket" || f.role == "metering";
  });
}

bool repaired(const MeshRepairs& r) {
  return r.non_finite_vertices + r.degenerate_triangles + r.duplicate_triangles +
                 r.non_manifold_edges >
             0 ||
         r.flipped_orientation;
}

}  // namespace

std::vector<LeftOutLine> left_out_lines(const SessionRecord& record, const Prepared& prepared,
                                        const BrdfBasis& basis) {
  std::vector<LeftOutLine> lines = planned_left_out(prepared);
  std::int64_t taken = 0, skipped = 0;
  for (const CapturedShot& shot : record.shots) {
    taken += used_exposures(shot);
    skipped += static_cast<std::int64_t>(shot.exposures_skipped.size());
  }
  lines.push_back({"exposures", "exposures", skipped, skipped + taken,
                   "the metering frame showed that no lit pixel needs them"});
  const int available = record.plan.left_out.components_available;
  lines.push_back({"components", "components of the fit",
                   std::max<std::int64_t>(available - basis.components(), 0), available,
                   record.spec.estimator == Estimator::map
                       ? "the prior makes limiting them needless"
                       : "the pseudo-inverse has no prior to hold them"});
  return lines;
}

std::string rank_loss(Estimator estimator, int rank, int components) {
  if (estimator != Estimator::pseudo_inverse || rank >= components) return {};
  return fmt::format(
      "The samples determine {} of the {} components: the pseudo-inverse leaves the others at the "
      "mean material and knows nothing there. Capture more lights, or reduce with the estimator "
      "map, whose prior says how far each may lie.",
      rank, components);
}

std::vector<std::string> warnings_of(const SessionRecord& record, const Prepared& prepared,
                                     const SessionResult& result) {
  std::vector<std::string> lines;
  for (const std::string& remark : prepared.remarks) {
    // What the object is, is no warning, what had to be repaired in it, is; nor is it one that
    // materials were left out because the session asks for it.
    const bool description = remark == prepared.object.description;
    if (held_out_as_asked(remark) || (description && !repaired(prepared.object.repairs))) continue;
    lines.push_back(remark);
  }
  for (const JournalEvent& event : record.events)
    if (event.event == "pose")
      if (std::string said = pose_warning(event); !said.empty()) lines.push_back(std::move(said));
  if (!result.absolute_scale) {
    lines.emplace_back(
        "The scale is nominal: it rests on the lamp strength and sensor response written in the "
        "rig file, not on a calibration. Shape and colour hold; absolute values may be off by one "
        "factor.");
  }
  if (result.model_sigma > 2 * result.expected_sigma) {
    lines.push_back(fmt::format(
        "The samples miss every mixture of the basis materials by {:.2f} (ln units) where {:.2f} "
        "was expected of a new material: this one is of a kind the basis does not hold, or pose "
        "and lamp are not as described. The fit trusts the samples accordingly less.",
        result.model_sigma, result.expected_sigma));
  }
  const std::int64_t cells = result.reconstruction.brdf.f.size();
  if (result.reconstruction.clipped_cells > 0) {
    lines.push_back(fmt::format(
        "{} of {} values lay outside what any basis material shows and were clipped to that range: "
        "the material may be unlike all of them.",
        result.reconstruction.clipped_cells, cells));
  }
  if (std::string lost = rank_loss(record.spec.estimator, result.coefficients.rank,
                                   static_cast<int>(result.coefficients.c.rows()));
      !lost.empty()) {
    lines.push_back(std::move(lost));
  }
  std::set<int> captured;
  for (const CapturedShot& shot : record.shots) captured.insert(shot.index);
  const auto missing = static_cast<std::ptrdiff_t>(record.plan.shots.size()) -
                       static_cast<std::ptrdiff_t>(captured.size());
  if (missing > 0) {
    lines.push_back(fmt::format("{} of {} planned lights are not in this result ({}).", missing,
                                record.plan.shots.size(), record.state));
  }
  for (const ReplanNote& note : result.replans) {
    lines.push_back(fmt::format(
        "{}: {} were chosen anew, for a predicted error of {:.2f} % instead of {:.2f} %.",
        note.reason, fmt::join(note.lights, ", "), note.percent, note.planned_percent));
  }
  for (const LightResult& light : result.lights) {
    const ExtractionStatistics& s = light.statistics;
    if (stands_in_the_way(s)) {
      lines.push_back(fmt::format(
          "{}: {} of {} lit pixels were as dark as without the lamp, where the darkest material of "
          "the basis, or this one as the other pixels tell it, would show: they are left out. Look "
          "for what stands between lamp and sample. If nothing does, the sample is darker there "
          "than the basis can say: add materials like it.",
          light.shot.name, s.blocked, lit_sites(s)));
    }
    const std::int64_t used = light.rows_value + light.rows_censored;
    if (used > 0 && 10 * light.rows_censored > 3 * used) {
      lines.push_back(fmt::format(
          "{}: {} of its {} bins are too bright or too dark for the exposures taken: offer a "
          "shorter or a longer one in [bracket].",
          light.shot.name, light.rows_censored, used));
    }
    if (used == 0) {
      lines.push_back(fmt::format("{}: gave no sample at all: check lamp, pose and exposure.",
                                  light.shot.name));
    }
  }
  if (result.held_out &&
      result.held_out->percent > 1.5 * result.reconstruction.predicted_high_percent) {
    lines.push_back(fmt::format(
        "The held-out light is {:.1f} % off where at most {:.1f} % was predicted: the object's "
        "pose, the lamp's position or strength, or the material's uniformity is not as described.",
        result.held_out->percent, result.reconstruction.predicted_high_percent));
  }
  return lines;
}

std::vector<LightResult> light_results(const Reduction& reduction, const Plan& plan) {
  std::vector<LightResult> lights;
  std::set<std::int32_t> seen;
  // Fitted lights in the order of capture, then the held-out ones: what is new in those, no fit
  // saw.
  for (const bool held_out : {false, true}) {
    for (std::size_t i = 0; i < reduction.shots().size(); ++i) {
      const ReducedShot& shot = reduction.shots()[i];
      if (shot.shot.held_out != held_out) continue;
      const BrdfObservations& observed = reduction.observations()[i];
      LightResult light;
      light.shot = shot.shot;
      light.light = shot.light;
      const SelectedLight& planned =
          plan.shots[static_cast<std::size_t>(shot.shot.index)].selection;
      light.condition = planned.condition;
      light.predicted_error_percent = planned.predicted_error_percent;
      for (const BrdfObservation& row : observed.rows) {
        (row.kind == BrdfObservation::Kind::value ? light.rows_value : light.rows_censored) += 1;
        light.new_cells += seen.insert(row.cell).second ? 1 : 0;
      }
      light.misfit_percent = held_out_error({&observed, 1}, reduction.reconstruction(),
                                            reduction.basis().mapping.floor)
                                 .seen_percent;
      light.statistics = observed.statistics;
      lights.push_back(std::move(light));
    }
  }
  return lights;
}

std::vector<ReplanNote> replans_of(const SessionRecord& record) {
  std::vector<ReplanNote> notes;
  for (const JournalEvent& event : record.events) {
    if (event.event != "replanned") continue;
    ReplanNote note;
    note.reason = event.fields.value("reason", std::string());
    for (const auto& light : event.fields["lights"]) {
      note.lights.push_back(shot_name(record.plan, light["index"].get<int>()));
    }
    if (event.fields.contains("predicted_error_percent")) {
      const auto& predicted = event.fields["predicted_error_percent"];
      note.planned_percent = predicted.value("as_planned", 0.0);
      note.percent = predicted.value("replanned", 0.0);
    }
    notes.push_back(std::move(note));
  }
  return notes;
}

std::string stop_fired(const SessionRecord& record) {
  for (auto event = record.events.rbegin(); event != record.events.rend(); ++event) {
    if (event->event != "ended" && event->event != "paused") continue;
    const std::string reason = event->fields.value("reason", std::string());
    if (!reason.empty()) return reason;
  }
  if (record.shots.size() == record.plan.shots.size()) return "all planned lights captured";
  return fmt::format("{} of {} lights captured so far", record.shots.size(),
                     record.plan.shots.size());
}

bool simulated(const SessionRecord& record) {
  if (std::holds_alternative<SimulatedCamera>(record.rig.camera.backend)) return true;
  // Every start notes what the camera says of itself.
  return std::any_of(record.events.begin(), record.events.end(), [](const JournalEvent& event) {
    if (event.event != "started" || !event.fields.contains("measured")) return false;
    const std::string camera = event.fields["measured"].value("camera", std::string());
    return camera.starts_with("lightrig simulated camera");
  });
}

std::vector<StageCost> capture_cost(const SessionRecord& record) {
  double homing = 0, darks = 0, exposing = 0, lights = 0, other = 0, before = 0;
  for (const JournalEvent& event : record.events) {
    const auto measured = event.fields.find("measured");
    if (measured == event.fields.end() || !measured->contains("elapsed_s")) continue;
    const double elapsed = (*measured)["elapsed_s"].get<double>();
    const double spent = std::max(0.0, elapsed - before);
    before = std::max(before, elapsed);
    if (event.event == "homed") {
      homing += spent;
    } else if (event.event == "dark") {
      darks += spent;
    } else if (event.event == "shot") {
      double exposed = 0;
      for (const auto& frame : event.fields["frames"]) exposed += frame["exposure_s"].get<double>();
      exposing += std::min(exposed, spent);
      lights += std::max(0.0, spent - exposed);
    } else {
      other += spent;
    }
  }
  std::vector<StageCost> cost;
  const auto add = [&](const char* stage, double seconds) {
    cost.emplace_back();
    cost.back().stage = stage;
    cost.back().seconds = seconds;
  };
  add("homing", homing);
  add("dark frames", darks);
  add("moving, settling, lamp, readout, storing", lights);
  add("exposing", exposing);
  if (other > 0) add("pauses, reference looks, resuming", other);
  return cost;
}

std::string describe(Estimator estimator, Eigen::Index components) {
  return estimator == Estimator::map
             ? fmt::format("MAP with the basis' prior, {} components", components)
             : fmt::format("pseudo-inverse, {} components", components);
}

std::string describe(const LogMapping& mapping) {
  switch (mapping.kind) {
    case Mapping::ln_floor:
      return "ln max(f, floor)";
    case Mapping::ln_offset:
      return "ln(f + floor)";
    case Mapping::log_relative:
      return "log-relative, cosine-weighted";
  }
  return "";
}

std::string describe(Criterion criterion) {
  return criterion == Criterion::condition ? "condition number κ² of the planned rows"
                                           : "least posterior variance (A-optimal)";
}

std::string describe(const Plan& plan) {
  switch (plan.stop) {
    case StopRule::literal:
      return "until the criterion no longer fell";
    case StopRule::plateau:
      return fmt::format("when a further light lowered the criterion by less than {:.0f} %",
                         100 * plan.stop_value);
    case StopRule::count:
      return fmt::format("after {:.0f} lights", plan.stop_value);
  }
  return "";
}

}  // namespace lightrig
