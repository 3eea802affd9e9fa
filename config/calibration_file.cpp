#include "config/calibration_file.h"

#include <fmt/format.h>
#include <openssl/evp.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <nlohmann/json.hpp>
#include <numbers>

#include "config/json_text.h"
#include "config/read_bytes.h"

namespace lightrig {
namespace {

using Json = nlohmann::ordered_json;

constexpr const char* camera_schema = "lightrig.camera/1";
constexpr const char* white_schema = "lightrig.white/1";

std::string sha256_of(const std::string& text) {
  std::array<unsigned char, EVP_MAX_MD_SIZE> digest{};
  unsigned length = 0;
  EVP_Digest(text.data(), text.size(), digest.data(), &length, EVP_sha256(), nullptr);
  std::string hex;
  for (unsigned i = 0; i < length; ++i) hex += fmt::format("{:02x}", digest[i]);
  return hex;
}

/// The document with the hash of what stands before it.
std::string sealed(Json json) {
  json["sha256"] = sha256_of(json_text(json));
  return json_text(json, 1) + "\n";
}

Json list_of(const Eigen::Ref<const Eigen::VectorXd>& values) {
  Json list = Json::array();
  for (const double value : values) list.push_back(value);
  return list;
}

/// `name` says from which frame, which the eye and the directions are in too.
Json pose_json(const char* name, const Eigen::Isometry3d& camera_from_frame) {
  const Eigen::Isometry3d frame_from_camera = camera_from_frame.inverse();
  Json rows = Json::array();
  for (Eigen::Index r = 0; r < 3; ++r)
    rows.push_back(list_of(camera_from_frame.matrix().row(r).transpose()));
  return {{name, std::move(rows)},
          {"eye_m", list_of(frame_from_camera.translation())},
          {"sight", list_of(frame_from_camera.linear().col(2))},
          {"up", list_of(Eigen::Vector3d(-frame_from_camera.linear().col(1)))}};
}

Json in_rig_json(const TargetInRig& placed, const CameraCalibration& calibration,
                 std::span<const MadeFrom> images) {
  const Eigen::Isometry3d& target = placed.rig_from_target;
  const RigPose stands = pose_in_rig(calibration.views[placed.view], target);
  Json json = pose_json("camera_from_rig", stands.camera_from_rig);
  json["standard_errors"] = {{"eye_m", list_of(stands.eye_sigma)},
                             {"turn_rad", list_of(stands.turn_sigma)}};
  json["target"] = {{"origin_m", list_of(target.translation())},
                    {"columns", list_of(target.linear().col(0))},
                    {"rows", list_of(target.linear().col(1))}};
  if (placed.view < images.size()) json["image"] = images[placed.view].name;
  return json;
}

tl::unexpected<Error> not_as_written(const char* what) {
  return fail(ErrorCode::invalid_input,
              fmt::format("is no {} as lightrig wrote it: it was changed or cut short; calibrate "
                          "again, or restore the file",
                          what));
}

/// The document with its seal, if that is whole.
Result<Json> read_sealed(const std::filesystem::path& file, const char* schema, const char* what) {
  const auto bytes = read_bytes(file);
  if (!bytes) return tl::unexpected(bytes.error());
  const auto* text = reinterpret_cast<const char*>(bytes->data());
  Json json = Json::parse(text, text + bytes->size(), nullptr, false);
  if (!json.is_object() || !json.contains("sha256") || !json.contains("schema") ||
      json["schema"] != schema || !json["sha256"].is_string())
    return not_as_written(what);
  const std::string seal = json["sha256"];
  json.erase("sha256");
  if (sha256_of(json_text(json)) != seal) return not_as_written(what);
  json["sha256"] = seal;
  return json;
}

CalibrationMark mark_of(const std::filesystem::path& file, const Json& json, double sigma) {
  return {file.filename().string(), json["date"], json["sha256"], sigma};
}

}  // namespace

Result<Eigen::Isometry3d> rig_from_target(const Eigen::Vector3d& origin,
                                          const Eigen::Vector3d& columns,
                                          const Eigen::Vector3d& rows) {
  constexpr double degree = std::numbers::pi / 180;
  if (!origin.allFinite() || !(columns.norm() > 0) || !(rows.norm() > 0) || !columns.allFinite() ||
      !rows.allFinite())
    return fail(ErrorCode::invalid_input,
                "the target's place needs an origin and two directions that are not zero");
  const Eigen::Vector3d x = columns.normalized();
  const double between = std::acos(std::clamp(x.dot(rows.normalized()), -1.0, 1.0)) / degree;
  if (!(std::abs(between - 90) < 1))
    return fail(ErrorCode::invalid_input,
                fmt::format("the target's columns and rows are counted in directions {:.1f}° "
                            "apart; on a flat target it is 90°",
                            between));
  const Eigen::Vector3d z = x.cross(rows).normalized();
  Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();
  pose.linear() << x, z.cross(x), z;
  pose.translation() = origin;
  return pose;
}

std::string camera_calibration_text(const CameraCalibration& calibration,
                                    const CalibrationTarget& target,
                                    std::span<const MadeFrom> images, const std::string& date,
                                    const std::optional<TargetInRig>& placed) {
  const CameraModel& m = calibration.model;
  const bool charuco = target.kind == CalibrationTarget::Kind::charuco;
  Json json{{"schema", camera_schema},
            {"date", date},
            {"width_px", m.width},
            {"height_px", m.height},
            {"fx_px", m.fx},
            {"fy_px", m.fy},
            {"cx_px", m.cx},
            {"cy_px", m.cy},
            {"distortion", m.distortion},
            {"standard_errors", calibration.sigma},
            {"rms_px", calibration.rms},
            {"noise_px", calibration.noise},
            {"picture_covered", calibration.covered},
            {"tilt_spread_rad", calibration.tilt_spread}};
  json["target"] = {{"kind", charuco ? "charuco" : "checkerboard"},
                    {"columns", target.columns},
                    {"rows", target.rows},
                    {"square_m", target.square}};
  if (charuco) json["target"]["marker_m"] = target.marker;
  json["images"] = Json::array();
  for (std::size_t i = 0; i < calibration.views.size(); ++i) {
    const ViewFit& view = calibration.views[i];
    Json one{{"corners", view.corners}, {"rms_px", view.rms}, {"worst_px", view.worst}};
    if (i < images.size()) {
      one["name"] = images[i].name;
      one["image_sha256"] = images[i].sha256;
    }
    one["pose"] = pose_json("camera_from_target", view.camera_from_target);
    one["pose_standard_errors"] = list_of(view.pose_sigma);
    json["images"].push_back(std::move(one));
  }
  if (placed) json["in_rig"] = in_rig_json(*placed, calibration, images);
  return sealed(std::move(json));
}

std::string white_reference_text(const WhiteReference& white, const std::string& date) {
  return sealed({{"schema", white_schema},
                 {"date", date},
                 {"session", white.session},
                 {"kind", white.near ? "near" : "distant"},
                 {"reflectance", list_of(white.reflectance.matrix())},
                 {"strength", list_of(white.strength.matrix())},
                 {"relative_standard_error", list_of(white.sigma.matrix())},
                 {"samples", white.samples}});
}

Result<bool> apply_camera_calibration(const std::filesystem::path& file, CameraConfig& camera) {
  const auto json = read_sealed(file, camera_schema, "camera calibration");
  if (!json) return tl::unexpected(json.error());
  CameraModel& m = camera.model;
  const int width = (*json)["width_px"], height = (*json)["height_px"];
  if (width != m.width || height != m.height)
    return fail(ErrorCode::invalid_input,
                fmt::format("is of pictures of {} × {} px; the rig's are {} × {}: calibrate with "
                            "pictures as the rig takes them",
                            width, height, m.width, m.height));
  m.fx = (*json)["fx_px"];
  m.fy = (*json)["fy_px"];
  m.cx = (*json)["cx_px"];
  m.cy = (*json)["cy_px"];
  m.distortion = (*json)["distortion"].get<std::array<double, 5>>();
  camera.calibration = file;
  camera.calibration_mark = mark_of(file, *json, (*json)["standard_errors"][0]);
  if (!json->contains("in_rig")) return false;
  const auto rows =
      (*json)["in_rig"]["camera_from_rig"].get<std::array<std::array<double, 4>, 3>>();
  for (std::size_t r = 0; r < 3; ++r)
    m.camera_from_world.matrix().row(static_cast<Eigen::Index>(r)) =
        Eigen::Map<const Eigen::RowVector4d>(rows[r].data());
  return true;
}

Result<void> apply_white_reference(const std::filesystem::path& file, bool near, LampConfig& lamp) {
  const auto json = read_sealed(file, white_schema, "white reference");
  if (!json) return tl::unexpected(json.error());
  if (((*json)["kind"] == "near") != near)
    return fail(ErrorCode::invalid_input, "is of a lamp of the other kind (near or distant)");
  const auto strength = (*json)["strength"].get<std::array<double, 3>>();
  lamp.strength = Eigen::Array3d(strength[0], strength[1], strength[2]);
  lamp.absolute_scale = true;
  lamp.white_reference = file;
  const auto sigma = (*json)["relative_standard_error"].get<std::array<double, 3>>();
  lamp.white_mark = mark_of(file, *json, std::ranges::max(sigma));
  return {};
}

}  // namespace lightrig
