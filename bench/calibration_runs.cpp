// Does `lightrig calibrate camera` find the truth within three of the standard errors that it
// states? Seeded runs, each with a lens, views and noise of its own: from corners with noise of
// 0.05 px, and from rendered pictures of the target, whose corners are found as in any picture.
// Counted for each of the lens' nine numbers and for the six of the first image's pose, and pooled
// over the poses of all images. Each run of a kind ends with a line of key=value figures.
//
//     calibration_runs --help
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <array>
#include <cmath>
#include <random>
#include <string>
#include <vector>

#include "core/calibrate_camera.h"
#include "target_scene.h"

namespace {

using namespace lightrig;

struct Options {
  int runs = 100, views = 15, first_seed = 1;
  std::string kind = "all";
  double corner_noise = 0.05, blur = 0.5, noise = 2;
  bool verbose = false;
};

CalibrationTarget board(CalibrationTarget::Kind kind) {
  CalibrationTarget target;
  target.kind = kind;
  target.square = 0.03;
  target.marker = 0.022;
  return target;
}

CameraModel drawn_camera(std::mt19937_64& random) {
  const auto between = [&](double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(random);
  };
  CameraModel camera;
  camera.width = 640;
  camera.height = 480;
  camera.fx = between(700, 1000);
  camera.fy = camera.fx * between(0.995, 1.005);
  camera.cx = 319.5 + between(-12, 12);
  camera.cy = 239.5 + between(-12, 12);
  camera.distortion = {between(-0.25, 0.05), between(0, 0.1), between(-0.001, 0.001),
                       between(-0.001, 0.001), between(-0.02, 0.02)};
  return camera;
}

struct Run {
  CameraModel truth;
  std::vector<Eigen::Isometry3d> poses;
  std::vector<TargetCorners> corners;
};

Run drawn_run(const std::string& kind, const Options& options, int seed) {
  std::mt19937_64 random(static_cast<std::uint64_t>(seed) * 7919U + kind.size());
  const bool charuco = kind != "checkerboard";
  const CalibrationTarget target =
      board(charuco ? CalibrationTarget::Kind::charuco : CalibrationTarget::Kind::checkerboard);
  Run run{drawn_camera(random), {}, {}};
  const auto views = test::drawn_views(run.truth, target, options.views, !charuco, random);
  if (kind == "corners") {
    std::normal_distribution<double> error(0, options.corner_noise);
    run.poses = views;
    for (const Eigen::Isometry3d& pose : views) {
      run.corners.push_back(test::true_corners(run.truth, pose, target));
      for (Eigen::Vector2d& pixel : run.corners.back().pixel)
        pixel += Eigen::Vector2d(error(random), error(random));
    }
    return run;
  }
  constexpr int pixels_per_square = 240;
  const GreyImage texture = target_image(target, pixels_per_square).value();
  const test::Sights sights(run.truth);
  test::TargetPicture how;
  how.blur = options.blur;
  how.noise = options.noise;
  for (const Eigen::Isometry3d& pose : views) {
    auto found = find_corners(
        test::picture_of_target(sights, pose, texture, target, pixels_per_square, how, random),
        target);
    if (!found) continue;
    run.poses.push_back(pose);
    run.corners.push_back(std::move(*found));
  }
  return run;
}

struct Tally {
  std::array<int, 9> lens{};
  std::array<int, 6> first_pose{};
  std::array<double, 9> lens_squares{}, lens_mean{};
  int refused = 0, runs = 0;
  long views = 0, poses = 0, poses_outside = 0;
  double squares = 0, pose_squares = 0, worst_rms = 0, noise = 0;
};

void add(const Run& run, const Options& options, int seed, Tally& tally) {
  const auto found = calibrate_camera(run.corners, run.truth.width, run.truth.height);
  if (!found) {
    ++tally.refused;
    fmt::print("  seed {}: refused: {}\n", seed, found.error().message);
    return;
  }
  const test::Deviations off = test::deviations(*found, run.truth, run.poses);
  ++tally.runs;
  tally.worst_rms = std::max(tally.worst_rms, found->rms);
  tally.noise += found->noise;
  tally.views += static_cast<long>(run.poses.size());
  for (std::size_t i = 0; i < 9; ++i) {
    tally.lens[i] += std::abs(off.lens[i]) > 3;
    tally.squares += off.lens[i] * off.lens[i] / 9;
    tally.lens_squares[i] += off.lens[i] * off.lens[i];
    tally.lens_mean[i] += off.lens[i];
  }
  for (std::size_t v = 0; v < off.poses.size(); ++v)
    for (std::size_t i = 0; i < 6; ++i) {
      const double z = off.poses[v][i];
      if (v == 0) tally.first_pose[i] += std::abs(z) > 3;
      tally.poses_outside += std::abs(z) > 3;
      ++tally.poses;
      tally.pose_squares += z * z;
    }
  if (!options.verbose) return;
  fmt::print("  seed {}: {} views, rms {:.4f} px, noise {:.4f} px, z", seed, run.poses.size(),
             found->rms, found->noise);
  for (const double z : off.lens) fmt::print(" {:+.1f}", z);
  fmt::print("\n");
}

void report(const std::string& kind, const Options& options) {
  Tally tally;
  for (int i = 0; i < options.runs; ++i) {
    const int seed = options.first_seed + i;
    add(drawn_run(kind, options, seed), options, seed, tally);
    std::fflush(stdout);
  }
  const char* names[] = {"fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3"};
  fmt::print("{}: runs beyond three standard errors", kind);
  for (std::size_t i = 0; i < 9; ++i) fmt::print(" {} {}", names[i], tally.lens[i]);
  fmt::print("; of the first image's turn {} {} {} and shift {} {} {}\n", tally.first_pose[0],
             tally.first_pose[1], tally.first_pose[2], tally.first_pose[3], tally.first_pose[4],
             tally.first_pose[5]);
  if (options.verbose)
    for (std::size_t i = 0; i < 9; ++i)
      fmt::print("  {}: mean {:+.2f}, mean square {:.2f}\n", names[i],
                 tally.lens_mean[i] / tally.runs, tally.lens_squares[i] / tally.runs);
  fmt::print(
      "kind={} runs={} refused={} views={:.1f} worst_rms_px={:.4f} noise_px={:.4f} "
      "worst_of_lens={} worst_of_pose={} pose_numbers_outside={:.2f}% lens_mean_square={:.2f} "
      "pose_mean_square={:.2f}\n",
      kind, tally.runs, tally.refused, static_cast<double>(tally.views) / tally.runs,
      tally.worst_rms, tally.noise / tally.runs, *std::ranges::max_element(tally.lens),
      *std::ranges::max_element(tally.first_pose),
      100.0 * static_cast<double>(tally.poses_outside) / static_cast<double>(tally.poses),
      tally.squares / tally.runs, tally.pose_squares / static_cast<double>(tally.poses));
}

}  // namespace

int main(int argc, char** argv) {
  Options options;
  CLI::App app{"Calibrations of a camera against the truth, in the errors they state"};
  app.add_option("--runs", options.runs)->check(CLI::Range(1, 100000))->capture_default_str();
  app.add_option("--seed", options.first_seed, "of the first run")->capture_default_str();
  app.add_option("--views", options.views, "images of the target")
      ->check(CLI::Range(4, 100))
      ->capture_default_str();
  app.add_option("--kind", options.kind)
      ->check(CLI::IsMember({"corners", "charuco", "checkerboard", "all"}))
      ->capture_default_str();
  app.add_option("--corner-noise", options.corner_noise, "of corners that no picture shows [px]")
      ->capture_default_str();
  app.add_option("--blur", options.blur, "of the lens [px]")->capture_default_str();
  app.add_option("--noise", options.noise, "of a pixel [DN]")->capture_default_str();
  app.add_flag("--verbose", options.verbose, "a line for every run");
  CLI11_PARSE(app, argc, argv);
  std::vector<std::string> kinds{options.kind};
  if (options.kind == "all") kinds = {"corners", "charuco", "checkerboard"};
  for (const std::string& kind : kinds) report(kind, options);
}
