#include "daemon/session/pose_check.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <array>
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

/// A picture of one colour, and the camera that sees it: where its sites have their middle, its
/// pixels have their centres.
struct OneColour {
  LitPicture picture;
  CameraModel camera;
};

/// Light of the lamp alone on the sites of one channel; of a mosaic the cells of 2 × 2 are pixels.
/// Pixel (i, j) has its centre at (i, j).
OneColour picture_of(const RadianceImage& image, const RadianceImage* ambient,
                     const SensorModel& sensor, int channel, const CameraModel& camera) {
  const int cell = sensor.filter == ColorFilter::mono ? 1 : 2;
  std::vector<std::array<int, 2>> sites;  // row, column within a cell
  double row = 0, column = 0;             // their mean
  for (int i = 0; i < cell * cell; ++i) {
    if (cell > 1 && channel_at(sensor.filter, i / cell, i % cell) != channel) continue;
    sites.push_back({i / cell, i % cell});
    row += i / cell;
    column += i % cell;
  }
  const auto count = static_cast<double>(sites.size());
  OneColour out{{image.width / cell, image.height / cell, {}, {}}, camera};
  out.camera.width = out.picture.width;
  out.camera.height = out.picture.height;
  out.camera.fx /= cell;
  out.camera.fy /= cell;
  out.camera.cx = (camera.cx - column / count) / cell;
  out.camera.cy = (camera.cy - row / count) / cell;
  const auto share = static_cast<float>(1 / count);
  for (int y = 0; y < out.picture.height; ++y) {
    for (int x = 0; x < out.picture.width; ++x) {
      float value = 0, variance = 0;
      for (const auto& site : sites) {
        const auto at =
            static_cast<std::size_t>(y * cell + site[0]) * static_cast<std::size_t>(image.width) +
            static_cast<std::size_t>(x * cell + site[1]);
        value += share * (image.L[at] - (ambient != nullptr ? ambient->L[at] : 0.0F));
        variance += share * share *
                    (image.variance[at] + (ambient != nullptr ? ambient->variance[at] : 0.0F));
      }
      const bool whole = std::isfinite(value) && std::isfinite(variance);
      out.picture.value.push_back(whole ? value : 0.0F);
      out.picture.variance.push_back(whole ? variance : std::numeric_limits<float>::infinity());
    }
  }
  return out;
}

/// How much a picture shows: light over noise, of all that has a value.
double strength(const LitPicture& picture) {
  double value = 0, variance = 0;
  for (std::size_t i = 0; i < picture.value.size(); ++i) {
    if (!std::isfinite(picture.variance[i])) continue;
    value += double{picture.value[i]};
    variance += double{picture.variance[i]};
  }
  return value / std::sqrt(std::max(variance, 1e-300));
}

/// The channel that shows most. All sites of a mosaic added would see a red object with one site of
/// four, off the middle: rims seemed to lie a quarter of a pixel away, and a scene lit from one
/// side a unit nearer.
OneColour clearest_colour(const RadianceImage& image, const RadianceImage* ambient,
                          const SensorModel& sensor, const CameraModel& camera) {
  OneColour best = picture_of(image, ambient, sensor, 0, camera);
  for (int channel = 1; channel < sensor.channels(); ++channel) {
    OneColour other = picture_of(image, ambient, sensor, channel, camera);
    if (strength(other.picture) > strength(best.picture)) best = std::move(other);
  }
  return best;
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
                           std::span<const Frame> lit, std::span<const Frame> dark,
                           const std::stop_token& stop) {
  const Shot& planned = prepared.plan.shots[static_cast<std::size_t>(shot)];
  const CameraModel camera = camera_at(rig.gantry.model, rig.camera.model, planned.gantry);
  const SensorModel& sensor = rig.camera.sensor;
  const int cell = sensor.filter == ColorFilter::mono ? 1 : 2;
  if (lit.empty() || !(extent_in_picture(prepared.object.mesh, camera) >= cell * least_pose_pixels))
    return PoseFit{};
  const auto image = merge_hdr(lit, {}, sensor, MergeOptions{});
  if (!image) return tl::unexpected(with_context("look for the object's pose", image.error()));
  std::optional<RadianceImage> ambient;
  if (!dark.empty()) {
    auto merged = merge_hdr(dark, {}, sensor, MergeOptions{});
    if (!merged) return tl::unexpected(with_context("look for the object's pose", merged.error()));
    ambient = std::move(*merged);
  }
  const OneColour seen = clearest_colour(*image, ambient ? &*ambient : nullptr, sensor, camera);
  PoseFit fit = fit_pose(seen.picture, prepared.object.mesh, *prepared.occluder, seen.camera,
                         planned.light, 1, most_pose_blocks, stop);
  if (stop.stop_requested())
    return fail(ErrorCode::stopped, "look for the object's pose: stopped on request");
  if (fit.seen_but_for_rims < fewest_motions && !unlike_model(fit)) fit.told = false;
  return fit;
}

Result<PoseFit> check_pose(const Rig& rig, const Prepared& prepared, const SessionFolder& folder,
                           const CapturedShot& shot, const std::stop_token& stop) {
  std::vector<Frame> lit, dark;
  for (const StoredFrame& stored : shot.frames) {
    if (stop.stop_requested()) break;
    auto frame = read_frame(folder.root / stored.file);
    if (!frame) return tl::unexpected(frame.error());
    (stored.role == "ambient" ? dark : lit).push_back(std::move(*frame));
  }
  if (stop.stop_requested())
    return fail(ErrorCode::stopped, "look for the object's pose: stopped on request");
  return judge_pose(rig, prepared, shot.index, lit, dark, stop);
}

std::vector<std::string> unseen_motions(const PoseFit& pose) {
  std::vector<std::string> unseen;
  for (Eigen::Index i = pose.motions_seen(); i < 6; ++i) {
    const Eigen::Vector3d turn = pose.motion.col(i).head<3>(), shift = pose.motion.col(i).tail<3>();
    const bool turns = turn.norm() > shift.norm();
    Eigen::Vector3d way = (turns ? turn : shift).normalized();
    Eigen::Index most = 0;
    way.cwiseAbs().maxCoeff(&most);
    if (way[most] < 0) way = -way;
    way = (way.array().abs() < 0.005).select(0, way);  // no −0.00
    unseen.push_back(fmt::format("{} ({:.2f}, {:.2f}, {:.2f})",
                                 turns ? "a turn about" : "a shift along", way.x(), way.y(),
                                 way.z()));
  }
  return unseen;
}

std::string in_words(const PoseFit& pose) {
  std::string words = fmt::format(
      "turned by {:.2f}° and shifted by {:.2f} mm, outlines overlapping by {:.1f} %, {} of 6 "
      "motions seen",
      degrees * pose.turn.norm(), 1000 * pose.shift.norm(), 100 * pose.overlap,
      pose.motions_seen());
  for (const std::string& one : unseen_motions(pose)) words += ", not " + one;
  return words;
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

nlohmann::ordered_json pose_fields(const PoseFit& pose, const std::string& shot, bool waits,
                                   const std::string& agreed_by) {
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
  fields["unseen"] = unseen_motions(pose);
  if (wrong(pose)) fields["reason"] = pose_reason(pose, waits);
  if (!agreed_by.empty()) fields["agreed_by"] = agreed_by;
  return fields;
}

std::string pose_warning(const JournalEvent& event) {
  const std::string at = "At " + event.fields.value("name", std::string()) + ": ";
  const std::string agreed = event.fields.value("agreed_by", std::string());
  if (event.fields.contains("reason"))
    return at + event.fields.value("reason", std::string()) +
           (agreed.empty() ? "" : " (" + agreed + " shows the same)");
  if (!event.fields.value("told", false))
    return "No light showed how the object lies: `lightrig snap --overlay` does.";
  const auto unseen = event.fields.value("unseen", std::vector<std::string>());
  if (unseen.empty()) return {};
  return at + fmt::format(
                  "the object lies as modelled as far as this light shows. It does not show {}: an "
                  "object off "
                  "by that alone goes unnoticed, unless it looks the same then. `lightrig snap "
                  "--overlay` shows it.",
                  fmt::join(unseen, ", nor "));
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
