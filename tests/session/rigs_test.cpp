// A whole simulated session on a small copy of a rig of every kind: a known material comes back.
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>
#include <regex>

#include "config/read_rig.h"
#include "daemon/session/calibrate.h"
#include "daemon/session/durable_file.h"
#include "daemon/session/pose_overlay.h"
#include "daemon/session/reduction.h"
#include "daemon/session/session.h"
#include "sim/open_devices.h"
#include "sim/sim_clock.h"
#include "tests/paths.h"
#include "tests/session/scratch.h"

namespace lightrig {
namespace {

namespace fs = std::filesystem;
using testing::HasSubstr;

std::string with(std::string text, const std::string& key, const std::string& value) {
  const std::regex line("(^|\n)" + key + " = [^\n]*");
  EXPECT_TRUE(std::regex_search(text, line)) << key;
  return std::regex_replace(text, line, "$1" + key + " = " + value,
                            std::regex_constants::format_first_only);
}

/// The shipped rig with a quarter of its pixels across and fewer lights.
std::string small_copy(const std::string& name, const fs::path& sessions) {
  std::string text =
      read_file(fs::path(test::source_dir) / "config/rigs" / (name + ".toml")).value();
  std::smatch focal;
  EXPECT_TRUE(std::regex_search(text, focal, std::regex("fx_px = ([0-9.]+)")));
  const double fx = std::stod(focal[1]);
  text = with(text, "width_px", "160");
  text = with(text, "height_px", "120");
  text = with(text, "fx_px", fmt::format("{}", fx / 4));
  text = with(text, "session_root", "\"" + sessions.string() + "\"");
  text = with(text, "max_lights", "4");
  text = with(text, "leave_out_families",
              R"(["plastic", "metal", "retroreflector", "fabric", "wood"])");
  return std::regex_replace(text, std::regex("\"\\.\\./controllers/"),
                            fmt::format("\"{}/config/controllers/", test::source_dir));
}

struct Session {
  Rig rig;
  SessionSpec spec;
  Prepared prepared;
  SessionFolder folder;
};

/// `strength`: of the lamp in truth, as a share of what the rig file says.
Session captured(const std::string& text, const fs::path& root, double strength = 1) {
  std::ofstream(root / "rig.toml") << text;
  const auto rig = read_rig(root / "rig.toml");
  EXPECT_TRUE(rig.value) << to_text(rig.diagnostics);
  const auto spec = read_session("", *rig.value);
  auto prepared = prepare(*rig.value, *spec.value);
  EXPECT_TRUE(prepared) << prepared.error().message;
  const auto folder = create_session(*rig.value, *spec.value, *prepared, "one");
  EXPECT_TRUE(folder) << folder.error().message;
  const auto clock = sim::make_clock(std::numeric_limits<double>::infinity());
  Rig truly = *rig.value;
  truly.lamp.strength *= strength;
  const auto world = sim::make_world(truly, spec.value->object, *clock, 1).value();
  Devices devices = sim::open_devices(*rig.value, world).value();
  SessionControl control;
  const SessionEnd end =
      capture(*folder, *rig.value, *spec.value, *prepared, devices, *clock, control, {});
  EXPECT_EQ(end.outcome, SessionOutcome::done) << end.reason;
  return {*rig.value, *spec.value, std::move(*prepared), *folder};
}

/// Four lights on a picture a sixteenth as large: bench/rig_table runs the rigs as they are
/// shipped.
class EveryRig : public testing::TestWithParam<std::string> {};

TEST_P(EveryRig, BringsAKnownMaterialBackBetterThanTheMeanMaterial) {
  const Scratch scratch;
  const Session session = captured(small_copy(GetParam(), scratch.path()), scratch.path());
  const auto summary = reduce_session(session.folder.root, "", 2);
  ASSERT_TRUE(summary) << summary.error().message;
  ASSERT_TRUE(summary->has_truth);
  EXPECT_LT(summary->true_error.percent_log, 25);
  EXPECT_LT(summary->true_error.percent_log, 0.85 * summary->mean_only_error_percent);
}

INSTANTIATE_TEST_SUITE_P(Shipped, EveryRig,
                         testing::Values("dome_bayer_demosaiced", "cartesian_aimed_bayer",
                                         "turntable_arm_bayer", "lamps_mono"));

TEST(Rigs, LeaveOutAndCountWhatWouldTouchHideOrDazzle) {
  const Scratch scratch;
  const std::string text = small_copy("dome_mono", scratch.path());
  std::ofstream(scratch.path() / "rig.toml") << text;
  const auto rig = read_rig(scratch.path() / "rig.toml");
  ASSERT_TRUE(rig.value) << to_text(rig.diagnostics);
  const Mesh object = load_object(rig.value->session_defaults.object).value().mesh;
  const CandidateLayout layout = lay_candidates(*rig.value, &object);
  EXPECT_EQ(layout.offered, 1000);
  EXPECT_EQ(layout.offered, static_cast<int>(layout.candidates.size() + layout.unusable.size()));
  EXPECT_GT(layout.count(NotUsable::unreachable), 400);  // all below the horizon, and a wedge
  EXPECT_GT(layout.count(NotUsable::kept_out), 0);       // the arm against the camera's barrel
  // Every way between neighbours that is called clear keeps the margin where it is sampled.
  const Obstacles obstacles = obstacles_of(*rig.value, &object);
  int clear = 0;
  for (std::size_t i = 1; i < layout.candidates.size(); i += 3) {
    const GantryPosition &from = layout.candidates[i - 1].gantry, &to = layout.candidates[i].gantry;
    if (!obstacle_on_the_way(*rig.value, obstacles, from, to).empty()) continue;
    ++clear;
    for (int k = 0; k <= 20; ++k) {
      GantryPosition here;
      here.axes = from.axes + (to.axes - from.axes) * (k / 20.0);
      ASSERT_GT(clearance(rig.value->gantry.model, obstacles.body, here, obstacles.solids).distance,
                obstacles.margin);
    }
  }
  EXPECT_GT(clear, 50);
}

TEST(WhiteReference, OfADiffuseTargetFindsTheLampsTrueStrength) {
  // PTFE of 98 %, under a lamp that is a fifth stronger than the 20 W/sr of its rig file.
  const Scratch scratch;
  std::string text = small_copy("lamps_mono", scratch.path());
  text = with(text, "shape", "\"sphere\"");
  text = with(text, "material", "\"sintered-ptfe\"");
  text = with(text, "leave_out_families", "[\"powder\"]");
  const Session session = captured(text, scratch.path(), 1.2);
  const auto white = white_reference_from(session.folder.root, Eigen::Array3d::Constant(0.98), 2);
  ASSERT_TRUE(white) << white.error().message;
  for (Eigen::Index c = 0; c < 3; ++c) EXPECT_NEAR(white->white.strength[c], 24, 0.25);
  EXPECT_THAT(white->text, HasSubstr("lightrig.white/1"));
}

TEST(WhiteReference, OfSomethingShinyIsRefused) {
  const Scratch scratch;
  std::string text = with(small_copy("lamps_mono", scratch.path()), "shape", "\"sphere\"");
  const Session session = captured(text, scratch.path());
  const auto white = white_reference_from(session.folder.root, Eigen::Array3d::Constant(0.98), 2);
  ASSERT_FALSE(white);
  EXPECT_THAT(white.error().message, HasSubstr("scatters"));
}

TEST(Overlay, DrawsTheOutlineWhereTheModelIsAndSaysWhereHighlightsWillBe) {
  const Scratch scratch;
  std::ofstream(scratch.path() / "rig.toml") << small_copy("lamps_mono", scratch.path());
  const auto rig = read_rig(scratch.path() / "rig.toml");
  ASSERT_TRUE(rig.value);
  const auto spec = read_session("", *rig.value);
  const auto prepared = prepare(*rig.value, *spec.value);
  ASSERT_TRUE(prepared) << prepared.error().message;
  const std::vector<ExpectedHighlight> highlights = expected_highlights(*rig.value, *prepared);
  EXPECT_GE(highlights.size(), 3U);
  for (const ExpectedHighlight& one : highlights) {
    EXPECT_GE(one.pixel.x(), 0);
    EXPECT_LT(one.pixel.x(), 160);
  }
}

}  // namespace
}  // namespace lightrig
