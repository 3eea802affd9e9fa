// calibrate: what a rig file takes from files rather than from people.
#include <fmt/format.h>

#include <algorithm>
#include <filesystem>
#include <numbers>
#include <optional>
#include <thread>
#include <utility>

#include "cli/json_fields.h"
#include "cli/say.h"
#include "cli/verbs.h"
#include "daemon/session/calibrate.h"
#include "daemon/session/durable_file.h"
#include "daemon/session/frame_file.h"

namespace lightrig::cli {
namespace {

CalibrationTarget target_of(const CalibrateOptions& options) {
  CalibrationTarget target;
  target.kind = options.kind == "charuco" ? CalibrationTarget::Kind::charuco
                                          : CalibrationTarget::Kind::checkerboard;
  target.columns = options.columns;
  target.rows = options.rows;
  target.square = options.square_mm / 1000;
  target.marker = options.marker_mm / 1000;
  return target;
}

std::optional<BoardPlace> board_of(const CalibrateOptions& options) {
  if (options.board_origin.empty()) return std::nullopt;
  const auto vector = [](const std::vector<double>& three) {
    return Eigen::Vector3d(three[0], three[1], three[2]);
  };
  return BoardPlace{options.board_image, vector(options.board_origin),
                    vector(options.board_columns), vector(options.board_rows)};
}

std::string camera_words(const CalibrationRun& run) {
  const CameraCalibration& c = run.calibration;
  std::vector<std::vector<std::string>> rows;
  const auto row = [&](const char* name, double value, std::size_t i) {
    rows.push_back({name, fmt::format("{:.5g}", value), fmt::format("± {:.2g}", c.sigma[i])});
  };
  row("fx_px", c.model.fx, 0);
  row("fy_px", c.model.fy, 1);
  row("cx_px", c.model.cx, 2);
  row("cy_px", c.model.cy, 3);
  const char* names[] = {"k1", "k2", "p1", "p2", "k3"};
  for (std::size_t i = 0; i < 5; ++i) row(names[i], c.model.distortion[i], 4 + i);
  std::string words = table({"value", "", "standard error"}, rows) + "\n";
  rows.clear();
  for (std::size_t i = 0; i < c.views.size(); ++i)
    rows.push_back({run.used[i].name, std::to_string(c.views[i].corners),
                    fmt::format("{:.3f}", c.views[i].rms),
                    fmt::format("{:.3f}", c.views[i].worst)});
  words += table({"image", "corners", "rms px", "worst px"}, rows);
  for (const std::string& one : run.skipped) words += "passed over: " + one + "\n";
  const Eigen::Isometry3d eye = c.model.camera_from_world.inverse();
  const Eigen::Vector3d at = eye.translation(), ahead = at + at.norm() * eye.linear().col(2);
  const Eigen::Vector3d up = -eye.linear().col(1);
  words += fmt::format(
      "\nrms {:.3f} px, noise {:.3f} px per coordinate, {:.0f} % of the picture covered\n"
      "camera {}:\n"
      "  eye_m = [{:.5f}, {:.5f}, {:.5f}]\n  target_m = [{:.5f}, {:.5f}, {:.5f}]\n"
      "  up = [{:.5f}, {:.5f}, {:.5f}]\n",
      c.rms, c.noise, 100 * c.covered,
      run.placed
          ? fmt::format("in the rig's frame, by the target in {}", run.used[run.placed->view].name)
          : "in the frame of the target as it lay in the first image used",
      at.x(), at.y(), at.z(), ahead.x(), ahead.y(), ahead.z(), up.x(), up.y(), up.z());
  if (run.placed) {
    const RigPose stands = pose_in_rig(c.views[run.placed->view], run.placed->rig_from_target);
    const Eigen::Vector3d mm = 1000 * stands.eye_sigma;
    const Eigen::Vector3d degrees = 180 / std::numbers::pi * stands.turn_sigma;
    words += fmt::format(
        "standard errors, the target's place taken as exact: eye {:.2g}, {:.2g}, {:.2g} mm; turned "
        "about x, y, z {:.2g}, {:.2g}, {:.2g}°\n",
        mm.x(), mm.y(), mm.z(), degrees.x(), degrees.y(), degrees.z());
  }
  return words;
}

/// The smallest sheet that holds so many millimetres either way round.
std::string paper_for(double width, double height) {
  const double across = std::max(width, height), up = std::min(width, height);
  double longer = 297, shorter = 210;
  for (int a = 4; a >= 0; --a) {
    if (across <= longer && up <= shorter) return fmt::format("for a sheet of A{}", a);
    shorter = std::exchange(longer, 2 * shorter);
  }
  return "more than a sheet of A0 holds";
}

}  // namespace

int calibrate_camera(const CalibrateOptions& options) {
  const std::vector<std::filesystem::path> images(options.images.begin(), options.images.end());
  const auto run = calibrate_camera_from(images, target_of(options), board_of(options));
  if (!run) return complain(with_context("calibrate the camera", run.error()));
  if (auto written = write_durably(options.output, run->text); !written)
    return complain(with_context("write the calibration", written.error()));
  for (const std::string& warning : run->warnings) complain("warning: " + warning);
  if (options.json) {
    say(run->text);
    return 0;
  }
  say(camera_words(*run) +
      fmt::format(
          "\nwritten to {}; name it in the rig file: [camera] calibration = \"{}\"{}",
          options.output, options.output,
          run->placed ? ", in place of fx_px, eye_m, target_m and up" : ", in place of fx_px"));
  return 0;
}

int calibrate_target(const CalibrateOptions& options) {
  constexpr int pixels_per_square = 200;
  const auto image = target_image(target_of(options), pixels_per_square);
  if (!image) return complain(with_context("draw the target", image.error()));
  const double per_mm = pixels_per_square / options.square_mm;
  const auto png = encode_png(image->width, image->height, 1, image->pixels, 1000 * per_mm);
  if (!png) return complain(with_context("draw the target", png.error()));
  if (auto written = write_durably(options.output, *png); !written)
    return complain(with_context("write the target", written.error()));
  say(fmt::format(
      "{}: {:g} × {:g} mm with its white margin, {}: print it at 100 %, not fitted to the page, on "
      "something flat and matt, and measure the print: a square is {:g} mm",
      options.output, image->width / per_mm, image->height / per_mm,
      paper_for(image->width / per_mm, image->height / per_mm), options.square_mm));
  return 0;
}

int calibrate_white(const CalibrateOptions& options) {
  Eigen::Array3d reflectance;
  for (std::size_t c = 0; c < 3; ++c) {
    const double value = options.reflectance[std::min(c, options.reflectance.size() - 1)];
    if (!(value > 0 && value <= 1.2))
      return complain(
          fmt::format("a reflectance of {} cannot be: give a number from 0 to 1", value));
    reflectance[static_cast<Eigen::Index>(c)] = value;
  }
  const auto threads = static_cast<int>(std::max(1U, std::thread::hardware_concurrency()));
  const auto run = white_reference_from(options.session, reflectance, threads);
  if (!run) return complain(with_context("take the white reference", run.error()));
  if (auto written = write_durably(options.output, run->text); !written)
    return complain(with_context("write the white reference", written.error()));
  if (options.json) {
    say(run->text);
    return 0;
  }
  const WhiteReference& white = run->white;
  const char* unit = white.near ? "W/sr" : "W/m²";
  say(fmt::format(
      "strength {:.4g}, {:.4g}, {:.4g} {} ± {:.2g} %, from {} samples\nwritten to {}; name "
      "it in the rig file: [lamp] white_reference = \"{}\"",
      white.strength[0], white.strength[1], white.strength[2], unit, 100 * white.sigma.maxCoeff(),
      white.samples, options.output, options.output));
  return 0;
}

}  // namespace lightrig::cli
