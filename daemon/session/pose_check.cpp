#include "daemon/session/pose_check.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <optional>
#include <vector>

#include "core/merge_hdr.h"
#include "daemon/session/frame_file.h"

namespace lightrig {
namespace {

constexpr double degrees = 180 / std::numbers::pi;

/// Light of the lamp alone. Four sites of a mosaic make one pixel, which has no colour.
LitPicture picture_of(const RadianceImage& image, const RadianceImage* ambient, int join) {
  LitPicture out{image.width / join, image.height / join, {}, {}};
  const auto share = 1.0F / static_cast<float>(join * join);
  for (int y = 0; y < out.height; ++y) {
    for (int x = 0; x < out.width; ++x) {
      float value = 0, variance = 0;
      for (int i = 0; i < join * join; ++i) {
        const auto at =
            static_cast<std::size_t>(y * join + i / join) * static_cast<std::size_t>(image.width) +
            static_cast<std::size_t>(x * join + i % join);
        value += share * (image.L[at] - (ambient != nullptr ? ambient->L[at] : 0.0F));
        variance += share * share *
                    (image.variance[at] + (ambient != nullptr ? ambient->variance[at] : 0.0F));
      }
      const bool whole = std::isfinite(value) && std::isfinite(variance);
      out.value.push_back(whole ? value : 0.0F);
      out.variance.push_back(whole ? variance : std::numeric_limits<float>::infinity());
    }
  }
  return out;
}

/// The camera whose pixels are `join` × `join` of this one's. Pixel (i, j) has its centre at
/// (i, j).
CameraModel joined(CameraModel camera, int join) {
  camera.width /= join;
  camera.height /= join;
  camera.fx /= join;
  camera.fy /= join;
  camera.cx = (camera.cx + 0.5) / join - 0.5;
  camera.cy = (camera.cy + 0.5) / join - 0.5;
  return camera;
}

}  // namespace

double extent_in_picture(const Mesh& mesh, const CameraModel& camera) {
  Eigen::Vector2d low = Eigen::Vector2d::Constant(std::numeric_limits<double>::infinity());
  Eigen::Vector2d high = -low;
  for (Eigen::Index i = 0; i < mesh.vertices.cols(); ++i) {
    const Eigen::Vector2d p = project(camera, mesh.vertices.col(i));
    if (!p.allFinite()) continue;
    low = low.cwiseMin(p);
    high = high.cwiseMax(p);
  }
  return (high - low).maxCoeff();
}

Result<PoseFit> judge_pose(const Rig& rig, const Prepared& prepared, int shot,
                           std::span<const Frame> lit, std::span<const Frame> dark) {
  const Shot& planned = prepared.plan.shots[static_cast<std::size_t>(shot)];
  const CameraModel camera = camera_at(rig.gantry.model, rig.camera.model, planned.gantry);
  const SensorModel& sensor = rig.camera.sensor;
  const int join = sensor.filter == ColorFilter::mono ? 1 : 2;
  if (lit.empty() || !(extent_in_picture(prepared.object.mesh, camera) >= join * least_pose_pixels))
    return PoseFit{};
  const auto image = merge_hdr(lit, {}, sensor, MergeOptions{});
  if (!image) return tl::unexpected(with_context("look for the object's pose", image.error()));
  std::optional<RadianceImage> ambient;
  if (!dark.empty()) {
    auto merged = merge_hdr(dark, {}, sensor, MergeOptions{});
    if (!merged) return tl::unexpected(with_context("look for the object's pose", merged.error()));
    ambient = std::move(*merged);
  }
  return fit_pose(picture_of(*image, ambient ? &*ambient : nullptr, join), prepared.object.mesh,
                  *prepared.occluder, joined(camera, join), planned.light, 1);
}

Result<PoseFit> check_pose(const Rig& rig, const Prepared& prepared, const SessionFolder& folder,
                           const CapturedShot& shot) {
  std::vector<Frame> lit, dark;
  for (const StoredFrame& stored : shot.frames) {
    auto frame = read_frame(folder.root / stored.file);
    if (!frame) return tl::unexpected(frame.error());
    (stored.role == "ambient" ? dark : lit).push_back(std::move(*frame));
  }
  return judge_pose(rig, prepared, shot.index, lit, dark);
}

std::string in_words(const PoseFit& pose) {
  return fmt::format(
      "turned by {:.2f}° and shifted by {:.2f} mm, outlines overlapping by {:.1f} %, {} of 6 "
      "motions seen",
      degrees * pose.turn.norm(), 1000 * pose.shift.norm(), 100 * pose.overlap,
      pose.motions_seen());
}

std::string pose_reason(const PoseFit& pose, bool waits) {
  const std::string remedy =
      std::string("; look at `lightrig snap --overlay`; ") +
      (waits ? "resume to go on with it as it is, or abort, put it right or correct [object], and "
               "start anew"
             : "where it is so, put it right or correct [object], and start a session anew");
  if (unlike_model(pose))
    return fmt::format(
               "the object does not look like its model where [object] has it: {:.0f} % of what "
               "is lit cannot be explained in any pose nearby",
               100 * pose.unexplained) +
           remedy;
  return "the object does not lie where [object] has it: it looks " + in_words(pose) + remedy;
}

nlohmann::ordered_json pose_fields(const PoseFit& pose, const std::string& shot, bool waits) {
  nlohmann::ordered_json fields{{"name", shot}, {"told", pose.told}};
  if (!pose.told) return fields;
  fields["as_modelled"] = !wrong(pose);
  fields["off"] = pose.off;
  fields["sure"] = pose.sure;
  fields["unexplained"] = pose.unexplained;
  fields["overlap"] = pose.overlap;
  fields["turn_deg"] = degrees * pose.turn.norm();
  fields["shift_mm"] = 1000 * pose.shift.norm();
  fields["motions_seen"] = pose.motions_seen();
  if (wrong(pose)) fields["reason"] = pose_reason(pose, waits);
  return fields;
}

PoseStanding pose_standing(std::span<const JournalEvent> events) {
  PoseStanding standing;
  std::string shot;
  for (const JournalEvent& event : events) {
    const auto word = [&](const char* key) {
      return event.fields.is_object() ? event.fields.value(key, std::string()) : std::string();
    };
    if (event.event == "pose") {
      const bool off = !event.fields.value("as_modelled", true);
      standing = {event.fields.value("told", false), off ? word("reason") : ""};
      shot = word("name");
    } else if (event.event == "resumed") {
      standing.held.clear();
    } else if (event.event == "retake" && word("name") == shot) {
      standing = {};
    }
  }
  return standing;
}

}  // namespace lightrig
