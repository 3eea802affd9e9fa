// Every shipped rig file is valid, and says of itself what its name says.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>
#include <set>

#include "config/calibration_file.h"
#include "config/read_rig.h"
#include "tests/config/scratch_folder.h"
#include "tests/paths.h"

namespace lightrig {
namespace {

namespace fs = std::filesystem;
using testing::HasSubstr;

const fs::path folder = fs::path(test::source_dir) / "config/rigs";

std::vector<fs::path> rig_files() {
  std::vector<fs::path> files;
  for (const auto& entry : fs::directory_iterator(folder)) files.push_back(entry.path());
  std::sort(files.begin(), files.end());
  return files;
}

Rig rig_of(const std::string& name) {
  const Read<Rig> read = read_rig(folder / (name + ".toml"));
  EXPECT_TRUE(read.value) << to_text(read.diagnostics);
  return read.value.value_or(Rig{});
}

TEST(ShippedRigs, AreValidWithoutAWarning) {
  for (const fs::path& file : rig_files()) {
    const Read<Rig> rig = read_rig(file);
    EXPECT_TRUE(rig.value) << to_text(rig.diagnostics);
    EXPECT_TRUE(rig.diagnostics.empty()) << to_text(rig.diagnostics);
  }
}

TEST(ShippedRigs, CoverEveryKinematicsAndEveryKindOfCamera) {
  std::set<std::size_t> kinematics;
  std::set<std::string> cameras;
  for (const fs::path& file : rig_files()) {
    const Read<Rig> rig = read_rig(file);
    ASSERT_TRUE(rig.value);
    kinematics.insert(rig.value->gantry.model.kinematics.index());
    cameras.insert(rig.value->camera.sensor.filter == ColorFilter::mono ? "mono"
                   : rig.value->camera.demosaic                         ? "demosaiced"
                                                                        : "sites");
  }
  EXPECT_EQ(kinematics.size(), std::variant_size_v<Kinematics>);
  EXPECT_EQ(cameras.size(), 3U);
}

TEST(ShippedRigs, KeepTheirUnits) {
  const Rig aimed = rig_of("cartesian_aimed_bayer");
  const GantryModel& gantry = aimed.gantry.model;
  ASSERT_EQ(gantry.axes.size(), 5U);
  EXPECT_EQ(gantry.axes[2].name, "z");
  EXPECT_FALSE(gantry.axes[2].rotary);
  EXPECT_DOUBLE_EQ(gantry.axes[2].max, 0.9);
  EXPECT_DOUBLE_EQ(gantry.axes[2].max_speed, 0.08);
  EXPECT_TRUE(gantry.axes[3].rotary);
  EXPECT_NEAR(gantry.axes[3].max, 185 * 3.14159265358979 / 180, 1e-12);
  EXPECT_NEAR(gantry.linear_tolerance, 2e-4, 1e-18);
  EXPECT_NEAR(gantry.lobe.towards(std::cos(0.2617993877991494)), 0.70, 1e-12);  // 15°
  const auto& drives = std::get<ModbusGantry>(aimed.gantry.backend).drives;
  EXPECT_NEAR(drives[0].counts_per_si, 200e3, 1e-6);  // per metre
  EXPECT_EQ(rig_of("lamps_mono").gantry.model.axes.front().max, 28);
}

class Edited : public testing::Test {
 protected:
  std::string problem(const std::string& name, const std::string& from, const std::string& to) {
    std::ifstream in(folder / (name + ".toml"));
    std::string text{std::istreambuf_iterator<char>(in), {}};
    const auto at = text.find(from);
    EXPECT_NE(at, std::string::npos) << from;
    text.replace(at, from.size(), to);
    const auto read = read_rig_text(text, folder / "edited.toml");
    EXPECT_FALSE(read.value);
    return to_text(read.diagnostics);
  }
};

TEST_F(Edited, AnAxisThatTheKinematicsDoNotHaveIsRefused) {
  EXPECT_THAT(problem("turntable_mono", "name = \"turn\"", "name = \"azimuth\""),
              HasSubstr("a turntable has no axis \"azimuth\""));
  EXPECT_THAT(problem("cartesian_mono", "name = \"z\"\nmin_mm = 0\nmax_mm = 400",
                      "name = \"pan\"\nmin_deg = 0\nmax_deg = 40"),
              HasSubstr("has no axis \"pan\""));
}

// demo.toml's neighbour: the profile's only output dims, so one is made that does not.
TEST_F(Edited, PowersBesideAnOutputThatOnlySwitchesAreRefused) {
  const auto profile = read_profile(folder / "../controllers/generic.toml");
  ASSERT_TRUE(profile.value);
  std::string text = profile.text;
  text.replace(text.find("dimmable = true"), 15, "dimmable = false");
  const ScratchFolder scratch;
  const std::string named = scratch.write("switch.toml", text).string();
  std::ifstream in(folder / "dome_mono.toml");
  std::string rig{std::istreambuf_iterator<char>(in), {}};
  const auto at = rig.find("profile = \"");
  rig.replace(at, rig.find('\n', at) - at, "profile = \"" + named + "\"");
  EXPECT_TRUE(read_rig_text(rig, folder / "edited.toml").value) << "full power needs no dimming";
  rig.replace(rig.find("\npower = 1.0"), 12, "\npower = 0.5");
  const auto read = read_rig_text(rig, folder / "edited.toml");
  EXPECT_FALSE(read.value);
  EXPECT_THAT(to_text(read.diagnostics),
              HasSubstr("lamp.power is 0.5, but output \"lamp\" of profile generic Modbus drive"));
}

TEST_F(Edited, WhatDoesNotGoTogetherIsRefused) {
  EXPECT_THAT(problem("turntable_mono", "rule = \"grid\"\nsteps = [36]", "count = 100"),
              HasSubstr("a turntable's candidates need rule \"grid\""));
  EXPECT_THAT(problem("turntable_mono", "lamp_elevation_deg = 5", ""),
              HasSubstr("needs lamp_elevation_deg"));
  EXPECT_THAT(problem("cartesian_mono", "steps = [12, 12, 5]", "steps = [12, 12]"),
              HasSubstr("candidates.steps has 2 numbers for 3 axes"));
  EXPECT_THAT(problem("cartesian_aimed_bayer", "sphere_radius_m = 0.7", ""),
              HasSubstr("sphere_radius_m"));
  EXPECT_THAT(problem("cartesian_aimed_bayer", "0.42, 0.15, 0.02", "0.42, 0.15"),
              HasSubstr("has 6 values for 7 angles"));
  EXPECT_THAT(problem("lamps_mono", "coil = 0", "holding = 3\nfull_scale = 100"),
              HasSubstr("fixed lamps need [lamp.modbus] with the coil"));
  EXPECT_THAT(
      problem("cartesian_mono", "tolerance_mm = 0.2", "tolerance_mm = 0.2\ntolerance_deg = 1"),
      HasSubstr("tolerance_deg goes with"));
}

CameraCalibration a_calibration() {
  CameraCalibration c;
  c.model.width = 640;
  c.model.height = 480;
  c.model.fx = 3212.5;
  c.model.fy = 3209.25;
  c.model.cx = 318.125;
  c.model.cy = 241.5;
  c.model.distortion = {-0.2, 0.1, 0.001, -0.002, 0.03};
  c.views.resize(1);
  c.views[0].pose_sigma.setZero();
  return c;
}

TEST(CalibrationFile, GivesTheRigItsLensAndRefusesWhatWasChanged) {
  const ScratchFolder scratch;
  const fs::path file = scratch.path / "camera.json";
  const std::string text =
      camera_calibration_text(a_calibration(), CalibrationTarget{}, {}, "2026-05-04T13:02:11Z");
  std::ofstream(file) << text;
  CameraConfig camera;
  camera.model.width = 640;
  camera.model.height = 480;
  ASSERT_TRUE(apply_camera_calibration(file, camera));
  EXPECT_EQ(camera.model.fx, 3212.5);
  EXPECT_EQ(camera.model.distortion[4], 0.03);
  camera.model.width = 1280;
  EXPECT_THAT(apply_camera_calibration(file, camera).error().message, HasSubstr("640 × 480"));
  std::string changed = text;
  changed.replace(changed.find("3212.5"), 6, "3212.6");
  std::ofstream(file) << changed;
  camera.model.width = 640;
  EXPECT_THAT(apply_camera_calibration(file, camera).error().message, HasSubstr("was changed"));
}

TEST(CalibrationFile, StatesWhereTheCameraStandsOnceTheTargetsPlaceIsSaid) {
  // The print lies face up on the table, its upper left corner at (0.1, 0.2, 0), its upper edge
  // along +y, its left edge along +x; the camera looks down on that corner from half a metre, with
  // the print's upper edge rightwards in the picture.
  CameraCalibration calibration = a_calibration();
  calibration.views[0].camera_from_target.translation() = Eigen::Vector3d(0, 0, 0.5);
  const auto target = rig_from_target({0.1, 0.2, 0}, {0, 2, 0}, {3, 0, 0});
  ASSERT_TRUE(target);
  const ScratchFolder scratch;
  const auto write = [&](const char* name, const std::optional<TargetInRig>& placed) {
    return scratch
        .write(name, camera_calibration_text(calibration, CalibrationTarget{}, {},
                                             "2026-05-04T13:02:11Z", placed))
        .string();
  };
  const std::string with = write("with.json", TargetInRig{0, *target});
  const std::string without = write("without.json", std::nullopt);
  CameraConfig camera;
  camera.model.width = 640;
  camera.model.height = 480;
  EXPECT_EQ(apply_camera_calibration(with, camera), true);
  const Eigen::Isometry3d stands = camera.model.camera_from_world.inverse();
  EXPECT_TRUE(stands.translation().isApprox(Eigen::Vector3d(0.1, 0.2, 0.5)));
  EXPECT_TRUE(stands.linear().col(2).isApprox(Eigen::Vector3d(0, 0, -1)));  // looks down
  EXPECT_TRUE(stands.linear().col(0).isApprox(Eigen::Vector3d(0, 1, 0)));   // rightwards: +y

  std::ifstream in(folder / "dome_mono.toml");
  const std::string shipped{std::istreambuf_iterator<char>(in), {}};
  const auto rig_with = [&](const std::string& file, bool eye) {
    std::string text = shipped;
    const auto line = [&](const std::string& key, const std::string& instead) {
      const auto at = text.find("\n" + key + " =") + 1;
      if (at != 0) text.replace(at, text.find('\n', at) - at, instead);
    };
    line("fx_px", "calibration = \"" + file + "\"");
    for (const char* key : {"fy_px", "cx_px", "cy_px", "distortion"}) line(key, "");
    line("width_px", "width_px = 640");
    line("height_px", "height_px = 480");
    for (const char* key : {"eye_m", "target_m", "up"})
      if (!eye) line(key, "");
    return read_rig_text(text, folder / "edited.toml");
  };
  const auto placed = rig_with(with, false);
  ASSERT_TRUE(placed.value) << to_text(placed.diagnostics);
  EXPECT_TRUE(
      placed.value->camera.model.camera_from_world.isApprox(camera.model.camera_from_world));
  EXPECT_TRUE(rig_with(without, true).value);
  EXPECT_THAT(to_text(rig_with(with, true).diagnostics),
              HasSubstr("camera.eye_m conflicts with calibration"));
  EXPECT_THAT(to_text(rig_with(without, false).diagnostics),
              HasSubstr("does not say where the camera stands"));
}

TEST(CalibrationFile, ATargetsPlaceNeedsDirectionsSquareToEachOther) {
  EXPECT_THAT(rig_from_target({0, 0, 0}, {1, 0, 0}, {0.2, 1, 0}).error().message,
              HasSubstr("78.7° apart"));
  EXPECT_FALSE(rig_from_target({0, 0, 0}, {1, 0, 0}, {0, 0, 0}));
}

TEST(CalibrationFile, AWhiteReferenceMakesTheScaleAbsolute) {
  const ScratchFolder scratch;
  const fs::path file = scratch.path / "white.json";
  WhiteReference white;
  white.strength = {18.5, 19.25, 17};
  std::ofstream(file) << white_reference_text(white, "2026-05-04T13:02:11Z");
  LampConfig lamp;
  ASSERT_TRUE(apply_white_reference(file, true, lamp));
  EXPECT_TRUE(lamp.absolute_scale);
  EXPECT_EQ(lamp.strength[1], 19.25);
  EXPECT_FALSE(apply_white_reference(file, false, lamp));
}

}  // namespace
}  // namespace lightrig
