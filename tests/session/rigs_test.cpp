// A whole simulated session on a small copy of a rig of every kind: a known material comes back.
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <fstream>
#include <random>
#include <regex>
#include <set>

#include "config/read_rig.h"
#include "core/shapes.h"
#include "daemon/session/calibrate.h"
#include "daemon/session/durable_file.h"
#include "daemon/session/frame_file.h"
#include "daemon/session/picture_file.h"
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

TEST(Rigs, OnATurntableNoAcceptedWayMeetsTheTurnedObjectAtAnyOfTenThousandPoses) {
  const Scratch scratch;
  std::ofstream(scratch.path() / "rig.toml") << small_copy("turntable_arm_bayer", scratch.path());
  const auto rig = read_rig(scratch.path() / "rig.toml");
  ASSERT_TRUE(rig.value) << to_text(rig.diagnostics);
  const GantryModel& model = rig.value->gantry.model;
  const Eigen::Vector3d centre = std::get<TurntableKinematics>(model.kinematics).centre;
  // Far off the axis, where the lamp swings past once in a turn.
  Mesh object = make_sphere(0.06, 1);
  object.vertices.colwise() += centre + Eigen::Vector3d(0.7, 0, 0.25);
  const Obstacles obstacles = obstacles_of(*rig.value, &object);
  std::mt19937 random(5);
  const auto anywhere = [&] {
    GantryPosition position;
    position.axes.resize(2);
    for (std::size_t i = 0; i < 2; ++i)
      position.axes[static_cast<Eigen::Index>(i)] =
          std::uniform_real_distribution<double>(model.axes[i].min, model.axes[i].max)(random);
    return position;
  };
  int poses = 0, refused = 0;
  while (poses < 10000) {
    const GantryPosition from = anywhere(), to = anywhere();
    if (!obstacle_on_the_way(*rig.value, obstacles, from, to).empty()) {
      ASSERT_LT(++refused, 10000);
      continue;
    }
    for (int k = 0; k <= 20; ++k, ++poses) {
      GantryPosition here;
      here.axes = from.axes + (to.axes - from.axes) * (k / 20.0);
      const Eigen::AngleAxisd turn(here.axes[0], Eigen::Vector3d::UnitZ());
      std::vector<Solid> points;
      for (Eigen::Index i = 0; i < object.vertices.cols(); i += 40)
        points.push_back(Ball{centre + turn * (object.vertices.col(i) - centre), 0});
      ASSERT_GT(clearance(model, obstacles.body, here, points).distance, obstacles.margin);
    }
  }
  EXPECT_GT(refused, 50);
}

TEST(RigsWithoutABody, AreRemarkedUponWhereHardwareMovesTheLamp) {
  const Scratch scratch;
  const auto without_body = [&](const std::string& name) {
    return std::regex_replace(small_copy(name, scratch.path()),
                              std::regex("\\[gantry\\.body\\]\n([^\\[\n][^\n]*\n)*"), "");
  };
  const auto rig_of = [&](const std::string& text) {
    const auto read = read_rig_text(text, scratch.path() / "rig.toml");
    EXPECT_TRUE(read.value) << to_text(read.diagnostics);
    const bool warned = to_text(read.diagnostics).find(no_body_remark) != std::string::npos;
    EXPECT_EQ(warned, moves_without_body(*read.value)) << "check and plan say the same";
    return *read.value;
  };
  EXPECT_FALSE(moves_without_body(rig_of(small_copy("dome_mono", scratch.path()))));
  EXPECT_TRUE(moves_without_body(rig_of(without_body("turntable_arm_bayer"))));
  EXPECT_FALSE(moves_without_body(rig_of(without_body("turntable_mono")))) << "the lamp stands";
  EXPECT_FALSE(moves_without_body(rig_of(small_copy("lamps_mono", scratch.path()))));
  const Rig bare = rig_of(without_body("dome_mono"));
  EXPECT_TRUE(moves_without_body(bare));
  const auto prepared = prepare(bare, *read_session("", bare).value);
  ASSERT_TRUE(prepared) << prepared.error().message;
  EXPECT_THAT(prepared->remarks, testing::Contains(std::string(no_body_remark)));
  Rig in_memory = bare;
  in_memory.gantry.backend = SimulatedGantry{};
  EXPECT_FALSE(moves_without_body(in_memory)) << "what moves in memory touches nothing";
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
  const Scratch written;
  ASSERT_TRUE(write_durably(written.path() / "white.json", white->text));
  LampConfig lamp;
  ASSERT_TRUE(apply_white_reference(written.path() / "white.json", true, lamp));
  EXPECT_EQ(lamp.white_mark.file, "white.json");
  EXPECT_FALSE(lamp.white_mark.date.empty());
  EXPECT_EQ(lamp.white_mark.sigma, white->white.sigma.maxCoeff());
}

TEST(WhiteReference, OfSomethingShinyIsRefused) {
  const Scratch scratch;
  std::string text = with(small_copy("lamps_mono", scratch.path()), "shape", "\"sphere\"");
  const Session session = captured(text, scratch.path());
  const auto white = white_reference_from(session.folder.root, Eigen::Array3d::Constant(0.98), 2);
  ASSERT_FALSE(white);
  EXPECT_THAT(white.error().message, HasSubstr("scatters"));
}

Prepared prepared_copy(const std::string& name, const fs::path& folder, Rig& rig) {
  std::ofstream(folder / "rig.toml") << small_copy(name, folder);
  auto read = read_rig(folder / "rig.toml");
  EXPECT_TRUE(read.value) << to_text(read.diagnostics);
  rig = *read.value;
  auto prepared = prepare(rig, *read_session("", rig).value);
  EXPECT_TRUE(prepared) << prepared.error().message;
  return std::move(*prepared);
}

TEST(Overlay, DrawsTheOutlineWhereTheModelIsAndSaysWhereHighlightsWillBe) {
  const Scratch scratch;
  Rig rig;
  const Prepared prepared = prepared_copy("lamps_mono", scratch.path(), rig);
  const GantryPosition home = home_position(rig.gantry.model);
  const ExpectedHighlights highlights = expected_highlights(rig, prepared, home);
  EXPECT_GE(highlights.seen.size(), 3U);
  EXPECT_TRUE(highlights.at_another_turn.empty());
  const auto black = encode_png(160, 120, 1, std::vector<std::uint8_t>(160 * 120, 0)).value();
  const std::string png(reinterpret_cast<const char*>(black.data()), black.size());
  const auto drawn = overlay_png(png, rig, prepared, home);
  ASSERT_TRUE(drawn) << drawn.error().message;
  ASSERT_TRUE(write_durably(scratch.path() / "drawn.png", *drawn));
  const GreyImage picture = read_grey_image(scratch.path() / "drawn.png").value();
  ASSERT_EQ(picture.width, 160);
  const auto at = [&](int x, int y) {
    return picture.pixels[static_cast<std::size_t>(y) * 160 + static_cast<std::size_t>(x)];
  };
  const auto seen = [&](int x, int y) {
    return prepared.occluder->first_hit(ray_through(rig.camera.model, x, y)).has_value();
  };
  int outline = 0;
  for (int y = 1; y < 120; ++y) {
    for (int x = 1; x < 160; ++x) {
      const bool edge = seen(x, y) != seen(x - 1, y) || seen(x, y) != seen(x, y - 1);
      outline += edge ? 1 : 0;
      if (edge) {
        EXPECT_GT(at(x, y), 0) << x << ", " << y;
      }
    }
  }
  EXPECT_GT(outline, 50);
  for (const ExpectedHighlight& one : highlights.seen) {
    EXPECT_GE(one.pixel.x(), 0);
    EXPECT_LT(one.pixel.x(), 160);
    // A ring of six pixels; brighter than the outline's green.
    const int x = static_cast<int>(std::lround(one.pixel.x())) + 6;
    EXPECT_GT(at(x, static_cast<int>(std::lround(one.pixel.y()))), 140);
  }
  // Beside the first ring its name: three by five a letter, from one pixel right of the ring's
  // edge.
  const Eigen::Vector2d first = highlights.seen.front().pixel;
  const int left = static_cast<int>(std::lround(first.x())) + 7;
  const int top = static_cast<int>(std::lround(first.y())) - 12;
  ASSERT_EQ(shot_name(prepared.plan, highlights.seen.front().shot), "L01");
  for (int y = 0; y < 5; ++y) EXPECT_GT(at(left, top + y), 140) << "the L's stem, " << y;
  EXPECT_LT(at(left + 1, top), 140);
  EXPECT_THAT(overlay_png("no picture", rig, prepared, home).error().message,
              HasSubstr("draw over the picture"));
}

TEST(Overlay, ShowsATurntableAsItStandsAndNamesTheLightsOfOtherTurns) {
  const Scratch scratch;
  Rig rig;
  const Prepared prepared = prepared_copy("turntable_arm_bayer", scratch.path(), rig);
  const std::vector<Shot>& shots = prepared.plan.shots;
  for (const Shot& stands : shots) {
    const ExpectedHighlights highlights = expected_highlights(rig, prepared, stands.gantry);
    std::set<int> of_this_turn(highlights.lights_nothing.begin(), highlights.lights_nothing.end());
    for (const ExpectedHighlight& one : highlights.seen) of_this_turn.insert(one.shot);
    EXPECT_FALSE(highlights.seen.empty());
    for (int s = 0; s < static_cast<int>(shots.size()); ++s) {
      const double turn = shots[static_cast<std::size_t>(s)].gantry.axes[0] - stands.gantry.axes[0];
      EXPECT_EQ(of_this_turn.contains(s), std::abs(turn) < 0.008) << s;
    }
    EXPECT_EQ(of_this_turn.size() + highlights.at_another_turn.size(), shots.size());
    // The highlight is where this turn's camera sees the surface, not the home turn's.
    for (const ExpectedHighlight& one : highlights.seen) {
      const CameraModel camera = camera_at(rig.gantry.model, rig.camera.model, stands.gantry);
      const auto hit =
          prepared.occluder->first_hit(ray_through(camera, one.pixel.x(), one.pixel.y()));
      EXPECT_TRUE(hit.has_value());
    }
  }
}

}  // namespace
}  // namespace lightrig
