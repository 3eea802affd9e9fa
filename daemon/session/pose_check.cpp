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

/// The radiance of the shot's frames of these roles; empty where there are none.
Result<std::optional<RadianceImage>> merged(const SessionFolder& folder, const CapturedShot& shot,
                                            const SensorModel& sensor, bool lit) {
  std::vector<Frame> frames;
  for (const StoredFrame& stored : shot.frames) {
    if ((stored.role == "bracket" || stored.role == "metering") != lit) continue;
    auto frame = read_frame(folder.root / stored.file);
    if (!frame) return tl::unexpected(frame.error());
    frames.push_back(std::move(*frame));
  }
  if (frames.empty()) return std::optional<RadianceImage>();
  auto image = merge_hdr(frames, {}, sensor, MergeOptions{});
  if (!image) return tl::unexpected(image.error());
  return std::optional<RadianceImage>(std::move(*image));
}

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

/// The camera whose pixels are `join` × `join` of this one's. Pixel (i, j) has its centre at (i,
/// j).
CameraModel joined(CameraModel camera, int join) {
  camera.width /= join;
  camera.height /= join;
  camera.fx /= join;
  camera.fy /= join;
  camera.cx = (camera.cx + 0.5) / join - 0.5;
  camera.cy = (camera.cy + 0.5) / join - 0.5;
  return camera;
}

/// The longer side of the object's box in the picture [px].
double extent_of(const Mesh& mesh, const CameraModel& camera) {
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

}  // namespace

Result<PoseFit> check_pose(const Rig& rig, const Prepared& prepared, const SessionFolder& folder,
                           const CapturedShot& shot) {
  const Shot& planned = prepared.plan.shots[static_cast<std::size_t>(shot.index)];
  const CameraModel camera = camera_at(rig.gantry.model, rig.camera.model, planned.gantry);
  if (extent_of(prepared.object.mesh, camera) < least_pose_pixels) return PoseFit{};
  const SensorModel& sensor = rig.camera.sensor;
  const auto lit = merged(folder, shot, sensor, true);
  if (!lit) return tl::unexpected(lit.error());
  if (!*lit) return PoseFit{};
  const auto ambient = merged(folder, shot, sensor, false);
  if (!ambient) return tl::unexpected(ambient.error());
  const int join = sensor.filter == ColorFilter::mono ? 1 : 2;
  const RadianceImage* unlit = *ambient ? &**ambient : nullptr;
  return fit_pose(picture_of(**lit, unlit, join), prepared.object.mesh, *prepared.occluder,
                  joined(camera, join), planned.light, 1);
}

nlohmann::ordered_json pose_fields(const PoseFit& pose, const std::string& shot) {
  const bool wrong = pose.off.norm() > pose_tolerance;
  nlohmann::ordered_json fields{{"name", shot},
                                {"as_modelled", !wrong},
                                {"overlap", pose.overlap},
                                {"turn_deg", pose.turn.norm() * 180 / std::numbers::pi},
                                {"shift_mm", 1000 * pose.shift.norm()},
                                {"directions_seen", pose.directions_seen}};
  if (wrong)
    fields["reason"] = fmt::format(
        "the object does not lie where [object] has it: it looks turned by {:.1f}° and shifted by "
        "{:.1f} mm, its outline overlaps the model's by {:.1f} %; look at it with `lightrig snap "
        "--overlay`, correct its place or the [object] pose, and measure again",
        pose.turn.norm() * 180 / std::numbers::pi, 1000 * pose.shift.norm(), 100 * pose.overlap);
  return fields;
}

}  // namespace lightrig
