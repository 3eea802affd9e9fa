#include "config/read_rig.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <numbers>
#include <sstream>
#include <string>

#include "core/builtin_materials.h"
#include "tests/paths.h"

namespace lightrig {
namespace {

namespace fs = std::filesystem;

constexpr double degree = std::numbers::pi / 180;

fs::path shipped(const std::string& name) {
  return fs::path(lightrig::test::source_dir) / "config" / name;
}

std::string text_of(const fs::path& file) {
  std::ifstream in(file, std::ios::binary);
  std::ostringstream text;
  text << in.rdbuf();
  return text.str();
}

/// What was said besides that the demo's gantry, and that of the wires, has no body.
std::string besides_the_body(std::vector<Diagnostic> diagnostics) {
  std::erase_if(diagnostics, [](const Diagnostic& one) { return one.message == no_body_remark; });
  return to_text(diagnostics);
}

Rig rig_of(const std::string& name) {
  const Read<Rig> read = read_rig(shipped(name));
  EXPECT_EQ(besides_the_body(read.diagnostics), "");
  EXPECT_TRUE(read.value.has_value());
  return read.value ? *read.value : Rig{};
}

TEST(ReadRig, TurnsTheDemosUnitsIntoSIAndRadians) {
  const Rig rig = rig_of("demo.toml");
  const GantryModel& gantry = rig.gantry.model;
  ASSERT_EQ(gantry.axes.size(), 2U);
  EXPECT_EQ(gantry.axes[0].name, "azimuth");
  EXPECT_DOUBLE_EQ(gantry.axes[0].min, -170 * degree);
  EXPECT_DOUBLE_EQ(gantry.axes[1].max_speed, 25 * degree);
  EXPECT_DOUBLE_EQ(gantry.axes[1].max_acceleration, 40 * degree);
  EXPECT_DOUBLE_EQ(gantry.tolerance, 0.02 * degree);
  EXPECT_DOUBLE_EQ(std::get<DomeKinematics>(gantry.kinematics).radius, 0.8);
  EXPECT_FALSE(gantry.distant_lamp);
  EXPECT_DOUBLE_EQ(rig.camera.readout_time, 0.040);
  EXPECT_EQ(rig.lamp.max_on_time, std::chrono::seconds(30));
  EXPECT_DOUBLE_EQ(rig.session_defaults.bracket.exposures.front(), 20e-6);
  ASSERT_TRUE(rig.simulation.has_value());
  EXPECT_DOUBLE_EQ(rig.simulation->ambient[2], 0.002);
}

TEST(ReadRig, OpensTheDemosHardwareByNameAndNothingElse) {
  const Rig rig = rig_of("demo.toml");
  const auto& gantry = std::get<ModbusGantry>(rig.gantry.backend);
  ASSERT_EQ(gantry.drives.size(), 2U);
  EXPECT_EQ(std::get<TcpEndpoint>(gantry.drives[1].endpoint).host, "192.168.10.20");
  EXPECT_EQ(gantry.drives[1].unit, 2);
  EXPECT_DOUBLE_EQ(gantry.drives[0].counts_per_si, 1000 / degree);
  EXPECT_EQ(gantry.controller.name, "generic Modbus drive");
  EXPECT_EQ(std::get<GantryLamp>(rig.lamp.backend).output, "lamp");
  EXPECT_EQ(std::get<AravisCamera>(rig.camera.backend).id, "192.168.10.30");
}

// The conditions in SI: shares, seconds; what is not named is not watched.
TEST(ReadRig, TakesTheConditionsThatPauseASessionAsTheyAreNamed) {
  std::string text = text_of(shipped("demo.toml"));
  EXPECT_FALSE(rig_of("demo.toml").pause.packet_loss);
  text += R"(
[pause.packet_loss]
pause_above_per_frame = 2
resume_below_per_frame = 0.25
resume_by_itself = true

[pause.lamp_drift]
pause_above_percent = 3
resume_below_percent = 1
recheck_minutes = 2

[pause.camera_temperature]
pause_above_c = 60
resume_below_c = 50
)";
  const Read<Rig> read = read_rig_text(text, shipped("demo.toml"));
  EXPECT_EQ(besides_the_body(read.diagnostics), "");
  ASSERT_TRUE(read.value);
  const PauseConditions& pause = read.value->pause;
  EXPECT_DOUBLE_EQ(pause.packet_loss->rule.resume_below, 0.25);
  EXPECT_TRUE(pause.packet_loss->rule.resume_by_itself);
  EXPECT_EQ(pause.packet_loss->over_frames, 20);
  EXPECT_DOUBLE_EQ(pause.lamp_drift->rule.pause_above, 0.03);
  EXPECT_EQ(pause.lamp_drift->every_lights, 5);
  EXPECT_DOUBLE_EQ(pause.lamp_drift->recheck, 120);
  EXPECT_FALSE(pause.lamp_drift->rule.resume_by_itself);
  EXPECT_DOUBLE_EQ(pause.camera_temperature->pause_above, 60);
  EXPECT_FALSE(pause.lamp_temperature);
}

// What `lightrig simulate` hosts is the demo's rig behind other wires: nothing but the gantry, the
// addresses and the waiting differs.
TEST(ReadRig, TheWireRigsAreTheDemosRigBehindOtherWires) {
  const Rig rig = rig_of("demo.toml");
  for (const char* name :
       {"wire_modbus_tcp.toml", "wire_modbus_rtu.toml", "wire_grbl.toml", "wire_usb.toml"}) {
    const Rig wire = rig_of(name);
    EXPECT_EQ(wire.camera.model.width, rig.camera.model.width) << name;
    EXPECT_EQ(wire.camera.sensor.bits, rig.camera.sensor.bits) << name;
    EXPECT_EQ(wire.gantry.model.axes.size(), rig.gantry.model.axes.size()) << name;
    EXPECT_EQ(wire.gantry.model.axes[0].max_speed, rig.gantry.model.axes[0].max_speed) << name;
    EXPECT_EQ(wire.simulation->material, rig.simulation->material) << name;
    EXPECT_EQ(wire.session_defaults.bracket.exposures, rig.session_defaults.bracket.exposures);
    EXPECT_EQ(wire.session_defaults.plan.max_lights, rig.session_defaults.plan.max_lights) << name;
    EXPECT_TRUE(std::holds_alternative<AravisCamera>(wire.camera.backend)) << name;
    EXPECT_TRUE(std::holds_alternative<GantryLamp>(wire.lamp.backend)) << name;
  }
  const auto tcp = std::get<ModbusGantry>(rig_of("wire_modbus_tcp.toml").gantry.backend);
  EXPECT_TRUE(std::holds_alternative<TcpEndpoint>(tcp.drives[1].endpoint));
  const auto rtu = std::get<ModbusGantry>(rig_of("wire_modbus_rtu.toml").gantry.backend);
  EXPECT_TRUE(std::holds_alternative<SerialEndpoint>(rtu.drives[1].endpoint));
  // A serial line needs time to recover before a watchdog barks.
  EXPECT_LT(4 * rtu.timeout, rtu.controller.watchdog->timeout);
  const auto usb = std::get<GrblGantry>(rig_of("wire_usb.toml").gantry.backend);
  EXPECT_TRUE(std::holds_alternative<UsbEndpoint>(usb.endpoint));
}

TEST(ReadRig, LooksAtTheTargetWithTheCentreOfTheImage) {
  for (const char* name : {"demo.toml", "paper.toml"}) {
    const CameraModel camera = rig_of(name).camera.model;
    const Eigen::Vector2d centre = project(camera, Eigen::Vector3d::Zero());
    EXPECT_NEAR(centre.x(), (camera.width - 1) / 2.0, 1e-9) << name;
    EXPECT_NEAR(centre.y(), (camera.height - 1) / 2.0, 1e-9) << name;
    // Up in the world is up in the image: rows count from the top.
    EXPECT_LT(project(camera, {0, 0, 0.01}).y(), centre.y()) << name;
  }
}

TEST(ReadRig, GivesThePaperItsRules) {
  const Rig rig = rig_of("paper.toml");
  const SessionSpec& spec = rig.session_defaults;
  EXPECT_TRUE(rig.gantry.model.distant_lamp);
  EXPECT_TRUE(distant(rig.camera.model));
  EXPECT_EQ(rig.candidates.count, 1000);
  EXPECT_EQ(spec.materials.components, 45);
  EXPECT_EQ(spec.materials.layout, ChannelLayout::stacked);
  EXPECT_EQ(spec.plan.criterion, Criterion::condition);
  EXPECT_EQ(spec.plan.stop, StopRule::plateau);
  EXPECT_DOUBLE_EQ(spec.plan.plateau, 0.2);
  EXPECT_EQ(spec.plan.points, PointSource::vertices);
  EXPECT_EQ(spec.estimator, Estimator::pseudo_inverse);
  EXPECT_EQ(spec.plan.limits.min_cos_i, no_grazing_limits.min_cos_i);
  EXPECT_DOUBLE_EQ(spec.plan.limits.max_theta_d, no_grazing_limits.max_theta_d);
}

// What the demo's numbers promise: a reflectance of 100 1/sr straight under the lamp fits into the
// well at the shortest exposure, and one of 0.001 1/sr still reaches a tenfold signal over noise at
// the longest. E = I/r², L = f E, e = response L t.
TEST(ReadRig, GivesTheDemoExposuresForFiveDecadesOfReflectance) {
  const Rig rig = rig_of("demo.toml");
  const SensorModel& sensor = rig.camera.sensor;
  const double irradiance = 20.0 / (0.8 * 0.8);
  const auto& exposures = rig.session_defaults.bracket.exposures;
  const double bright = sensor.response.maxCoeff() * 100 * irradiance * exposures.front();
  const double dim = sensor.response.minCoeff() * 0.001 * irradiance * exposures.back();
  EXPECT_LT(bright, sensor.full_well);
  EXPECT_GT(bright, 0.5 * sensor.full_well);
  EXPECT_GT(dim / std::sqrt(dim + sensor.read_noise * sensor.read_noise), 10);
  for (std::size_t i = 1; i < exposures.size(); ++i)
    EXPECT_NEAR(exposures[i] / exposures[i - 1], 4, 1e-9);
}

TEST(ReadRig, HoldsTheSimulatedMaterialsFamilyOutOfTheDemosBasis) {
  for (const char* name : {"demo.toml", "paper.toml"}) {
    const Rig rig = rig_of(name);
    const BuiltinMaterial* truth = find_builtin(rig.simulation->material);
    ASSERT_NE(truth, nullptr) << name;
    EXPECT_EQ(rig.session_defaults.materials.leave_out_families,
              std::vector<std::string>{truth->family});
  }
}

TEST(ReadRig, FindsDefaultsOfTheTomlAndOfTheTypesAlike) {
  // A table that is empty in the file, and a value of the type as C++ makes it.
  Rig rig = rig_of("faulty/base/rig.toml");
  const auto read = read_session_text("[plan]\n[materials]\n[stop]\n", "s.toml", rig);
  ASSERT_TRUE(read.value) << to_text(read.diagnostics);
  const SessionSpec made;
  EXPECT_EQ(read.value->plan.criterion, made.plan.criterion);
  EXPECT_EQ(read.value->plan.stop, made.plan.stop);
  EXPECT_EQ(read.value->plan.plateau, made.plan.plateau);
  EXPECT_EQ(read.value->plan.max_lights, made.plan.max_lights);
  EXPECT_EQ(read.value->plan.points, made.plan.points);
  EXPECT_EQ(read.value->plan.shadows, made.plan.shadows);
  EXPECT_DOUBLE_EQ(read.value->plan.limits.max_theta_d, made.plan.limits.max_theta_d);
  EXPECT_NEAR(read.value->plan.limits.min_cos_i, made.plan.limits.min_cos_i, 1e-15);
  EXPECT_EQ(read.value->plan.held_out_lights, made.plan.held_out_lights);
  EXPECT_EQ(read.value->plan.random_baseline, made.plan.random_baseline);
  EXPECT_EQ(read.value->estimator, made.estimator);
  EXPECT_EQ(read.value->materials.source, made.materials.source);
  EXPECT_EQ(read.value->materials.layout, made.materials.layout);
  EXPECT_EQ(read.value->materials.floor, made.materials.floor);
  EXPECT_EQ(read.value->bracket.target_snr, made.bracket.target_snr);
  EXPECT_EQ(rig.gantry.move_time_factor, GantryConfig{}.move_time_factor);
  EXPECT_EQ(rig.gantry.homing_timeout, GantryConfig{}.homing_timeout);
}

TEST(ReadSession, ReplacesTheRigsTableAsAWhole) {
  const Rig rig = rig_of("demo.toml");
  const auto read = read_session_text("[plan]\nmax_lights = 3\n", "s.toml", rig);
  ASSERT_TRUE(read.value) << to_text(read.diagnostics);
  EXPECT_EQ(read.value->plan.max_lights, 3);
  EXPECT_EQ(read.value->plan.criterion, Criterion::condition) << "not the rig file's a-optimal";
  EXPECT_EQ(read.value->object.shape, "teapot") << "a table it does not hold is the rig file's";
}

TEST(ReadSession, NeedsNoFileWhereTheRigHoldsAll) {
  const Rig rig = rig_of("demo.toml");
  const auto read = read_session({}, rig);
  ASSERT_TRUE(read.value) << to_text(read.diagnostics);
  EXPECT_EQ(read.value->sample_id, "demo");
}

TEST(ReadSession, SaysThatARigWithoutObjectIsNoSession) {
  Rig rig = rig_of("faulty/base/rig.toml");
  const auto at = rig.text.find("[object]");
  rig.text = rig.text.substr(0, at);
  const auto read = read_session({}, rig);
  ASSERT_FALSE(read.value);
  ASSERT_EQ(read.diagnostics.size(), 2U);
  EXPECT_NE(read.diagnostics[0].message.find("[object]"), std::string::npos);
  EXPECT_NE(read.diagnostics[1].message.find("[bracket]"), std::string::npos);
}

TEST(ReadSession, ResolvesPathsAgainstItsOwnFolder) {
  const Rig rig = rig_of("demo.toml");
  const auto read = read_session_text("[object]\nmesh = \"meshes/a.ply\"\nunit_m = 0.001\n",
                                      "/lab/monday/s.toml", rig, NamedFiles::may_be_absent);
  ASSERT_TRUE(read.value) << to_text(read.diagnostics);
  EXPECT_EQ(read.value->object.mesh, "/lab/monday/meshes/a.ply");
  EXPECT_DOUBLE_EQ(read.value->object.unit, 0.001);
}

TEST(ReadSession, TurnsAboutXThenYThenZBeforeItMoves) {
  const Rig rig = rig_of("demo.toml");
  const auto read = read_session_text(
      "[object]\nshape = \"sphere\"\nsize_m = 1\nrotation_deg = [90, 90, 0]\nposition_m = [1, 2, "
      "3]\n",
      "s.toml", rig);
  ASSERT_TRUE(read.value) << to_text(read.diagnostics);
  // ŷ turned 90° about x is ẑ; ẑ turned 90° about y is x̂; then moved.
  const Eigen::Vector3d p = read.value->object.world_from_object * Eigen::Vector3d::UnitY();
  EXPECT_NEAR((p - Eigen::Vector3d(2, 2, 3)).norm(), 0, 1e-15);
}

TEST(ReadRig, KnowsAStoredRigWhoseNamedFilesAreGone) {
  const Rig rig = rig_of("demo.toml");
  EXPECT_FALSE(read_rig_text(rig.text, "/elsewhere/rig.toml").value);
  const auto read = read_rig_text(rig.text, "/elsewhere/rig.toml", NamedFiles::may_be_absent);
  EXPECT_TRUE(read.value) << to_text(read.diagnostics);
}

TEST(ReadRig, SaysWhatIsWrongWithAPathThatIsNoFile) {
  for (const auto& [path, why] :
       {std::pair("/nonexistent/rig.toml", "No such file"), std::pair("/tmp", "directory"),
        std::pair("/dev/null", "not a regular file")}) {
    const auto read = read_rig(path);
    ASSERT_EQ(read.diagnostics.size(), 1U) << path;
    EXPECT_EQ(read.diagnostics[0].line, 0);
    EXPECT_NE(read.diagnostics[0].message.find(why), std::string::npos)
        << read.diagnostics[0].message;
    EXPECT_FALSE(read.value);
  }
}

// A rig file cut at any byte is refused or valid, never a crash; and what is refused has a place.
TEST(ReadRig, SurvivesBeingCutAtAnyByte) {
  const std::string text = rig_of("demo.toml").text;
  int valid = 0;
  for (std::size_t n = 0; n < text.size(); n += 7) {
    const auto read = read_rig_text(text.substr(0, n), shipped("cut.toml"));
    EXPECT_NE(read.value.has_value(), has_error(read.diagnostics)) << n;
    valid += read.value.has_value() ? 1 : 0;
  }
  EXPECT_GT(valid, 0) << "the last bytes are a session's own";
}

TEST(EffectiveValues, SayWhereEachValueCameFrom) {
  const Rig rig = rig_of("demo.toml");
  const auto read = read_session_text("[plan]\nmax_lights = 3\n", "s.toml", rig);
  ASSERT_TRUE(read.value);
  const auto lines = effective_values(rig, *read.value);
  const auto has = [&](const std::string& line) {
    return std::ranges::find(lines, line) != lines.end();
  };
  EXPECT_TRUE(has("plan.max_lights = 3  # s.toml:2"));
  EXPECT_TRUE(has("plan.criterion = \"condition\"  # default"));
  EXPECT_TRUE(has("rig.name = \"demo dome\"  # demo.toml:5"));
  EXPECT_TRUE(has("camera.up = [0, 0, 1]  # default"));
  // Nothing of what has no effect: a perspective camera has no scale.
  EXPECT_TRUE(std::ranges::none_of(
      lines, [](const std::string& l) { return l.find("scale_px_per_m") != std::string::npos; }));
}

}  // namespace
}  // namespace lightrig
