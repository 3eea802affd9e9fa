// Does the check at a session's start see a pose that is off, and let a right one pass?
// bench/pose_cases runs hundreds.
#include "daemon/session/pose_check.h"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <limits>
#include <numbers>
#include <optional>
#include <random>

#include "config/read_rig.h"
#include "core/builtin_materials.h"
#include "core/shapes.h"
#include "daemon/session/durable_file.h"
#include "daemon/session/pose_opinion.h"
#include "daemon/session/session.h"
#include "sim/open_devices.h"
#include "sim/shading.h"
#include "sim/sim_clock.h"
#include "tests/paths.h"
#include "tests/session/scratch.h"

namespace lightrig {
namespace {

using testing::HasSubstr;

constexpr double degree = std::numbers::pi / 180;

/// An object of 0.12 m before a camera a metre away, 160 pixels wide, under a lamp on its side.
/// Pictures come from the laboratory's renderer, which shares no code with the check, with photon
/// and read noise.
struct Scene {
  Scene(Mesh object, const std::string& name) : mesh(std::move(object)), material(name) {
    camera.width = 160;
    camera.height = 120;
    camera.fx = camera.fy = 1000;
    camera.cx = 79.5;
    camera.cy = 59.5;
    camera.camera_from_world = look_at({0, -0.9, 0.45}, {0, 0, 0}, Eigen::Vector3d::UnitZ());
    const Eigen::Vector3d low = mesh.vertices.rowwise().minCoeff();
    const Eigen::Vector3d high = mesh.vertices.rowwise().maxCoeff();
    mesh.vertices.colwise() -= (low + high) / 2;
    mesh.vertices *= 0.12 / (high - low).maxCoeff();
    occluder.emplace(mesh);
    light.p = Eigen::Vector3d(0.25, -0.5, 0.57);
  }

  PoseFit seen(const Eigen::Isometry3d& motion, const std::stop_token& stop = {}) {
    Mesh moved = mesh;
    moved.vertices = (motion.linear() * moved.vertices).colwise() + motion.translation();
    moved.normals = motion.linear() * moved.normals;
    const sim::Renderer renderer(std::move(moved), camera, ColorFilter::mono,
                                 find_builtin(material)->reflectance, {2, 1, random()});
    const auto radiance = renderer.render(light, Eigen::Array3d::Constant(20), {}).value();
    LitPicture picture{camera.width, camera.height, {}, {}};
    std::normal_distribution<double> normal(0, 1);
    for (const float L : radiance) {
      const double electrons = 2000 * double{L}, variance = electrons + 12;
      picture.value.push_back(static_cast<float>(electrons + std::sqrt(variance) * normal(random)));
      picture.variance.push_back(static_cast<float>(variance));
    }
    return fit_pose(picture, mesh, *occluder, camera, light, 1, most_pose_blocks, stop);
  }

  Mesh mesh;
  std::string material;
  std::mt19937 random{5};
  CameraModel camera;
  std::optional<Occluder> occluder;
  LightPosition light;
};

Eigen::Isometry3d turned(double angle, const Eigen::Vector3d& axis) {
  return Eigen::Isometry3d(Eigen::AngleAxisd(angle, axis.normalized()));
}

Eigen::Isometry3d shifted(const Eigen::Vector3d& by) {
  return Eigen::Isometry3d(Eigen::Translation3d(by));
}

TEST(PoseCheck, FlagsADegreeAndTwoPerCentAndLetsARightPosePassWhateverTheMaterial) {
  for (const char* material : {"polystyrene-maroon", "felt-pink"}) {
    Scene scene(make_teapot(1, 1), material);
    const PoseFit right = scene.seen(Eigen::Isometry3d::Identity());
    EXPECT_TRUE(right.told);
    EXPECT_FALSE(wrong(right)) << material << " off " << right.off;
    const PoseFit turn = scene.seen(turned(degree, {1, -1, 0.5}));
    EXPECT_TRUE(wrong(turn)) << material;
    EXPECT_NEAR(turn.turn.norm(), degree, 0.5 * degree);
    const PoseFit shift = scene.seen(shifted({0.0024, 0, 0}));
    EXPECT_TRUE(wrong(shift)) << material;
    EXPECT_NEAR(shift.shift.x(), 0.0024, 0.0012);
  }
}

TEST(PoseCheck, WhatTheModelLeavesUnexplainedMakesTheVerdictMoreCareful) {
  PoseFit pose;
  pose.told = true;
  pose.sure = 0.6;
  pose.unexplained = 0.05;
  EXPECT_TRUE(wrong(pose));
  pose.unexplained = 0.25;
  EXPECT_FALSE(wrong(pose));
  pose.sure = 0.9;
  EXPECT_TRUE(wrong(pose));
  pose.sure = 0;
  pose.unexplained = 0.31;
  EXPECT_TRUE(wrong(pose)) << "another object";
  pose.told = false;
  EXPECT_FALSE(wrong(pose));
}

TEST(PoseCheck, ATurnedSphereIsNoFaultAndAShiftedOneIs) {
  Scene scene(make_sphere(1, 1), "polystyrene-maroon");
  const PoseFit turn = scene.seen(turned(5 * degree, {1, 2, 3}));
  EXPECT_TRUE(turn.told);
  EXPECT_FALSE(wrong(turn)) << turn.off;
  EXPECT_LT(turn.motions_seen(), 6);
  EXPECT_GE(std::ranges::count_if(
                unseen_motions(turn),
                [](const std::string& motion) { return motion.starts_with("a turn about"); }),
            3);
  EXPECT_TRUE(wrong(scene.seen(shifted({0.0024, 0, 0}))));
}

TEST(PoseCheck, ACylindersTurnAboutItsAxisIsSaidToBeUnseenNotToBeRight) {
  Scene scene(make_cylinder(0.3, 1, 1), "polystyrene-maroon");
  const PoseFit turn = scene.seen(turned(5 * degree, {0, 0, 1}));
  EXPECT_TRUE(turn.told);
  EXPECT_FALSE(wrong(turn)) << turn.off;
  const std::vector<std::string> unseen = unseen_motions(turn);
  ASSERT_FALSE(unseen.empty());
  double x = 0, y = 0, z = 0;
  ASSERT_EQ(std::sscanf(unseen.back().c_str(), "a turn about (%lf, %lf, %lf)", &x, &y, &z), 3)
      << unseen.back();
  EXPECT_GT(z, 0.98) << unseen.back();
  EXPECT_THAT(in_words(turn), testing::HasSubstr("motions seen, not a "));
  EXPECT_EQ(pose_fields(turn, "0001", false)["unseen"].size(), unseen.size());
}

TEST(PoseCheck, ADarkPictureIsNotJudgedAndAnotherObjectIsUnlikeTheModel) {
  Scene scene(make_teapot(1, 1), "polystyrene-maroon");
  const LitPicture dark{160, 120, std::vector<float>(160 * 120, 0),
                        std::vector<float>(160 * 120, 12)};
  EXPECT_FALSE(fit_pose(dark, scene.mesh, *scene.occluder, scene.camera, scene.light, 1).told);
  EXPECT_TRUE(wrong(scene.seen(turned(90 * degree, {0, 0, 1}))));
}

TEST(PoseCheck, SaysNothingOnceToldToStop) {
  Scene scene(make_teapot(1, 1), "polystyrene-maroon");
  std::stop_source stop;
  stop.request_stop();
  EXPECT_FALSE(scene.seen(turned(5 * degree, {1, 0, 0}), stop.get_token()).told);
}

/// A look that sees all motions but the last `unseen`, each to a tenth of a unit, and finds the
/// object off by `off` along its i-th axis.
PoseFit look(double off, Eigen::Index axis = 0, int unseen = 0) {
  PoseFit fit;
  fit.told = true;
  fit.unexplained = 0.01;
  fit.deviation.setConstant(0.1);
  fit.deviation.tail(unseen).setOnes();
  fit.judged[axis] = off;
  fit.off = std::abs(off);
  fit.sure = fit.off - 0.1;
  return fit;
}

PoseOpinion opinion_of(const std::vector<PoseFit>& looks) { return opinion(looks); }

TEST(PoseOpinion, ALightThatFindsNothingWrongIsBelievedAtOnce) {
  const PoseOpinion one = opinion_of({look(0.1)});
  EXPECT_TRUE(one.decided);
  EXPECT_EQ(one.by, 0);
}

TEST(PoseOpinion, AWrongPoseNeedsASecondLightThatSeesTheSameMotion) {
  EXPECT_FALSE(opinion_of({look(1)}).decided);
  EXPECT_EQ(opinion_of({look(1)}).by, 0);  // and is gone by where no other light comes
  const PoseOpinion agreed = opinion_of({look(1), look(0.9)});
  EXPECT_TRUE(agreed.decided);
  EXPECT_EQ(agreed.by, 0);
  EXPECT_EQ(agreed.second, 1);
}

TEST(PoseOpinion, WhatAMirrorBendsAtOneLightTheNextOneClears) {
  const PoseOpinion cleared = opinion_of({look(1), look(0.1)});
  EXPECT_TRUE(cleared.decided);
  EXPECT_EQ(cleared.by, 1);
  EXPECT_EQ(cleared.second, std::nullopt);
  // Bent another way: that is not agreement, and the new doubt is for a third to tell.
  const PoseOpinion bent = opinion_of({look(1), look(-0.9)});
  EXPECT_FALSE(bent.decided);
  EXPECT_EQ(bent.by, 1);
  EXPECT_EQ(opinion_of({look(1, 0), look(1, 3), look(0.9, 3)}).second, 2);
}

TEST(PoseOpinion, ALightThatDoesNotShowTheMotionNeitherAgreesNorClears) {
  EXPECT_FALSE(opinion_of({look(1, 5), look(0, 0, 1)}).decided);
  const PoseOpinion agreed = opinion_of({look(1, 5), look(0, 0, 1), look(1, 5)});
  EXPECT_TRUE(agreed.decided);
  EXPECT_EQ(agreed.by, 0);
  EXPECT_EQ(agreed.second, 2);
  EXPECT_EQ(opinion_of({look(1, 5), look(0, 0, 1), look(0)}).by, 2);
}

TEST(PoseOpinion, AnotherObjectIsOneAtTwoLights) {
  PoseFit other = look(0.1);
  other.unexplained = 0.4;
  EXPECT_FALSE(opinion_of({other}).decided);
  EXPECT_EQ(opinion_of({other, other}).second, 1);
  EXPECT_EQ(opinion_of({other, look(0)}).by, 1);
  PoseFit untold;
  EXPECT_FALSE(opinion_of({untold}).decided);
  EXPECT_EQ(opinion_of({other, untold, other}).second, 2);
}

TEST(PoseCheck, AReportSaysWhatNoLightShowed) {
  const auto warning = [](const PoseFit& fit, const char* agreed_by) {
    return pose_warning({1, "pose", pose_fields(fit, "L03", false, agreed_by)});
  };
  EXPECT_EQ(warning(look(0), ""), "");
  EXPECT_THAT(warning(look(0, 0, 1), ""),
              testing::AllOf(HasSubstr("At L03"), HasSubstr("as far as this light shows"),
                             HasSubstr("does not show a shift along (0.00, 0.00, 1.00)")));
  EXPECT_THAT(warning(look(1), "L05"),
              testing::AllOf(HasSubstr("does not lie where"), HasSubstr("(L05 shows the same)")));
  EXPECT_THAT(warning(PoseFit{}, ""), HasSubstr("No light showed how the object lies"));
}

TEST(PoseCheck, AJournalSaysWhetherAPersonHasAccepted) {
  const JournalEvent shot{1, "shot", {{"name", "L01"}}};
  const JournalEvent off{
      2, "pose", {{"name", "L01"}, {"told", true}, {"as_modelled", false}, {"reason", "off"}}};
  const JournalEvent well{2, "pose", {{"name", "L01"}, {"told", true}, {"as_modelled", true}}};
  const JournalEvent paused{3, "paused", {{"why", "condition"}}}, resumed{4, "resumed", {}};
  const JournalEvent again{5, "retake", {{"name", "L01"}}};
  const auto standing = [](std::vector<JournalEvent> events) { return pose_standing(events); };
  EXPECT_FALSE(standing({shot}).looked);
  EXPECT_TRUE(standing({shot, well}).looked);
  EXPECT_EQ(standing({shot, well}).held, "");
  EXPECT_FALSE(standing({shot, {2, "pose", {{"name", "L01"}, {"told", false}}}}).looked);
  EXPECT_EQ(standing({shot, off}).held, "off");
  EXPECT_EQ(standing({shot, off, paused}).held, "off");  // pulled while it waited: it waits again
  EXPECT_EQ(standing({shot, off, paused, resumed}).held, "");
  EXPECT_FALSE(standing({shot, off, paused, resumed, again}).looked);
}

/// The demo on half of its pixels each way, the object truly turned by so much.
std::string little_demo(const std::filesystem::path& root, double pose_error_deg,
                        bool waits = true) {
  std::string text =
      read_file(std::filesystem::path(test::source_dir) / "config/demo.toml").value();
  const auto put = [&](const std::string& from, const std::string& to) {
    const auto at = text.find(from);
    EXPECT_NE(at, std::string::npos) << from;
    text.replace(at, from.size(), to);
  };
  put("width_px = 640", "width_px = 320");
  put("height_px = 480", "height_px = 240");
  put("fx_px = 3478", "fx_px = 1739");
  put("max_lights = 7", "max_lights = 3");
  put("count = 1000", "count = 200");
  put("\"../sessions\"", fmt::format("\"{}\"", root.string()));
  put("\"controllers/", fmt::format("\"{}/config/controllers/", test::source_dir));
  put("seed = 1\n", fmt::format("seed = 1\npose_error_deg = {}\n", pose_error_deg));
  put("[plan]\n", "[plan]\nrandom_baseline = false\n");
  if (waits) text += "\n[pause]\nwrong_pose = true\n";
  return text;
}

/// Runs a session until it ends, or stops it where it waits; what its journal then holds.
Replay run_session(const std::string& text, const std::filesystem::path& root, bool accept) {
  std::ofstream(root / "rig.toml") << text;
  const auto rig = read_rig(root / "rig.toml");
  EXPECT_TRUE(rig.value) << to_text(rig.diagnostics);
  const auto spec = read_session("", *rig.value);
  const auto prepared = prepare(*rig.value, *spec.value);
  EXPECT_TRUE(prepared) << prepared.error().message;
  const auto folder = create_session(*rig.value, *spec.value, *prepared, "one");
  EXPECT_TRUE(folder) << folder.error().message;
  for (int part = 0; part < 3; ++part) {
    const auto clock = sim::make_clock(std::numeric_limits<double>::infinity());
    const auto world = sim::make_world(*rig.value, spec.value->object, *clock, 1).value();
    Devices devices = sim::open_devices(*rig.value, world).value();
    SessionControl here;
    SessionListeners listeners;
    Prepared planned = *prepared;
    // First it is pulled while it waits, then a person accepts, or the test has seen enough.
    listeners.event = [&](const JournalEvent& event) {
      if (event.event != "paused") return;
      if (part == 0)
        here.halt("pulled");
      else if (accept)
        here.resume();
      else
        here.abort("seen");
    };
    const SessionEnd end =
        capture(*folder, *rig.value, *spec.value, planned, devices, *clock, here, listeners);
    if (end.outcome != SessionOutcome::paused) break;
  }
  return replay_journal(folder->journal()).value();
}

int count(const Replay& replay, const std::string& event) {
  return static_cast<int>(std::ranges::count_if(
      replay.events, [&](const JournalEvent& one) { return one.event == event; }));
}

bool tells_pose(const JournalEvent& event) {
  return event.event == "pose" && event.fields.value("told", false);
}

TEST(PoseCheck, ASessionOnATurnedObjectWaitsOnceTwoLightsAgreeEvenIfPulledAndResumeAccepts) {
  const Scratch scratch;
  const Replay replay = run_session(little_demo(scratch.path(), 2), scratch.path(), true);
  const auto pose = std::ranges::find_if(replay.events, tells_pose);
  ASSERT_NE(pose, replay.events.end());
  EXPECT_FALSE(pose->fields.value("as_modelled", true)) << pose->fields.dump();
  EXPECT_NEAR(pose->fields.value("turn_deg", 0.0), 2, 0.7);
  EXPECT_NE(pose->fields.value("agreed_by", ""), "") << pose->fields.dump();
  EXPECT_EQ(std::ranges::count_if(replay.events, tells_pose), 1);  // told once, held twice
  EXPECT_EQ(count(replay, "paused"), 2);
  EXPECT_EQ(count(replay, "resumed"), 1);
  EXPECT_EQ(count(replay, "shot"), 4);
  const auto held = std::ranges::find(replay.events, "paused", &JournalEvent::event);
  ASSERT_NE(held, replay.events.end());
  EXPECT_THAT(held->fields.value("reason", ""), HasSubstr("[object]"));
  EXPECT_EQ((pose - 1)->event, "shot");
  EXPECT_EQ((pose + 1)->event, "paused");
}

TEST(PoseCheck, ASessionOnARightlyPosedObjectNeverWaits) {
  const Scratch scratch;
  const Replay replay = run_session(little_demo(scratch.path(), 0), scratch.path(), false);
  const auto pose = std::ranges::find_if(replay.events, tells_pose);
  ASSERT_NE(pose, replay.events.end());
  EXPECT_TRUE(pose->fields.value("as_modelled", false)) << pose->fields.dump();
  // Maroon is seen by one site of a mosaic's four: taken for the middle of them, it lay off.
  EXPECT_LT(pose->fields.value("off", 1.0), 0.2) << pose->fields.dump();
  EXPECT_EQ(count(replay, "paused"), 0);
  EXPECT_EQ(count(replay, "shot"), 4);
}

TEST(PoseCheck, WhereNobodyIsWaitedForThePoseIsStillToldByTheShotThatShowedIt) {
  const Scratch scratch;
  const Replay replay = run_session(little_demo(scratch.path(), 0, false), scratch.path(), false);
  const auto pose = std::ranges::find_if(replay.events, tells_pose);
  ASSERT_NE(pose, replay.events.end());
  const auto first = std::ranges::find(replay.events, "shot", &JournalEvent::event);
  EXPECT_EQ(pose->fields.value("name", ""), first->fields.value("name", "-"));
}

TEST(PoseReason, AsksForAWordOnlyWhereTheSessionWaits) {
  PoseFit pose;
  pose.told = true;
  pose.sure = 10;
  EXPECT_THAT(pose_reason(pose, true), testing::HasSubstr("resume to go on"));
  EXPECT_THAT(pose_reason(pose, false), testing::Not(testing::HasSubstr("resume")));
  EXPECT_THAT(pose_reason(pose, false), testing::HasSubstr("snap --overlay"));
}

}  // namespace
}  // namespace lightrig
