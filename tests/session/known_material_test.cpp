// From a plan to a result: a known material comes back, and a session ends when enough is captured.
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "daemon/session/reduction.h"
#include "tests/session/scene.h"
#include "tests/session/scratch.h"

namespace lightrig {
namespace {

using testing::HasSubstr;

// The whole path, judged against what the simulated sample really is: a material whose family the
// basis has never seen comes back far nearer than the mean of all materials.
TEST(KnownMaterial, ComesBackFromTheFolderAlone) {
  const Scratch scratch;
  const Rig rig = small_rig(
      scratch.path(), {{R"("plastic", "metal", "metallic-paint", "powder", "retroreflector", )"
                        R"("fabric", "stone", "wood")",
                        R"("plastic")"},
                       {"max_lights = 3", "max_lights = 6"},
                       {R"("mono")", R"("bayer_rggb")"},
                       {"= 1.6e5", "= [1.3e5, 1.6e5, 1.1e5]"},
                       {"width_px = 48", "width_px = 320"},
                       {"height_px = 36", "height_px = 240"},
                       {"fx_px = 300", "fx_px = 2000"}});
  auto prepared = prepare(rig, spec_of(rig));
  ASSERT_TRUE(prepared) << prepared.error().message;
  const auto folder = create_session(rig, spec_of(rig), *prepared, "s");
  ASSERT_TRUE(folder) << folder.error().message;
  Laboratory laboratory(rig);
  SessionControl control;
  const SessionEnd end = capture(*folder, rig, spec_of(rig), *prepared, laboratory.devices,
                                 *laboratory.clock, control, {}, laboratory.reopen());
  ASSERT_EQ(end.outcome, SessionOutcome::done) << end.reason;
  const auto summary = reduce_session(folder->root, folder->root, 2);
  ASSERT_TRUE(summary) << summary.error().message;
  ASSERT_TRUE(summary->has_truth);
  fmt::print("true error {:.2f} %, the mean material alone {:.2f} %\n",
             summary->true_error.percent_log, summary->mean_only_error_percent);
  EXPECT_LT(summary->true_error.percent_log, 0.35 * summary->mean_only_error_percent);
  EXPECT_LT(summary->true_error.percent_log, 8);
  ASSERT_TRUE(seal_session(*folder));
}

struct Stop {
  const char* name;
  const char* rule;    // the line of [stop]
  const char* reason;  // what the journal is to say
};
class StopRuleOf : public testing::TestWithParam<Stop> {};

// Eight lights are planned, and either rule is met long before they are taken.
TEST_P(StopRuleOf, EndsTheSessionEarlyAndTheFolderSaysWhy) {
  const Scratch scratch;
  const Rig rig = small_rig(
      scratch.path(), {{"max_lights = 3", "max_lights = 8"},
                       {"[session]", fmt::format("[stop]\n{}\n\n[session]", GetParam().rule)}});
  auto prepared = prepare(rig, spec_of(rig));
  ASSERT_TRUE(prepared) << prepared.error().message;
  const auto folder = create_session(rig, spec_of(rig), *prepared, "s");
  ASSERT_TRUE(folder);
  Laboratory laboratory(rig);
  SessionControl control;
  const SessionEnd end = capture(*folder, rig, spec_of(rig), *prepared, laboratory.devices,
                                 *laboratory.clock, control, {}, laboratory.reopen());
  fmt::print("{}\n", end.reason);
  EXPECT_EQ(end.outcome, SessionOutcome::stopped_early) << end.reason;
  EXPECT_THAT(end.reason, HasSubstr(GetParam().reason));
  const std::size_t taken = read_session_folder(folder->root).value().shots.size();
  EXPECT_GE(taken, 1U);
  EXPECT_LT(taken, prepared->plan.shots.size());
}
INSTANTIATE_TEST_SUITE_P(Rules, StopRuleOf,
                         testing::Values(Stop{"Error", "predicted_error_percent = 25",
                                              "has reached [stop]"},
                                         Stop{"Minutes", "minutes = 0.5", "[stop] minutes = 0.5"}),
                         [](const auto& rule) { return std::string(rule.param.name); });

TEST(StopConfig, NoLightIsBegunThatWouldOverrunItsMinutes) {
  const Scratch scratch;
  const Rig rig = small_rig(scratch.path(), {{"max_lights = 3", "max_lights = 8"},
                                             {"[session]", "[stop]\nminutes = 0.5\n\n[session]"}});
  auto prepared = prepare(rig, spec_of(rig));
  ASSERT_TRUE(prepared) << prepared.error().message;
  const auto folder = create_session(rig, spec_of(rig), *prepared, "s");
  ASSERT_TRUE(folder);
  Laboratory laboratory(rig);
  SessionControl control;
  const SessionEnd end = capture(*folder, rig, spec_of(rig), *prepared, laboratory.devices,
                                 *laboratory.clock, control, {}, laboratory.reopen());
  EXPECT_EQ(end.outcome, SessionOutcome::stopped_early) << end.reason;
  EXPECT_THAT(end.reason, HasSubstr("s are left"));
  // A light is 8 s: at the first one that does not fit, nearly all of the half minute is used.
  const double elapsed = read_session_folder(folder->root)
                             ->events.back()
                             .fields["measured"]["elapsed_s"]
                             .get<double>();
  EXPECT_LE(elapsed, 30);
  EXPECT_GT(elapsed, 20);
}

TEST(StopConfig, EndsTheSessionEarlyWhenEnoughLightsAreCaptured) {
  const Scratch scratch;
  const Rig rig = small_rig(scratch.path(), {{"[session]", "[stop]\nlights = 2\n\n[session]"}});
  auto prepared = prepare(rig, spec_of(rig));
  ASSERT_TRUE(prepared) << prepared.error().message;
  // The held-out light first, then by worth: whenever it ends, what counts most is captured.
  EXPECT_EQ(prepared->plan.visit_order, (std::vector<int>{3, 0, 1, 2}));
  const auto folder = create_session(rig, spec_of(rig), *prepared, "s");
  ASSERT_TRUE(folder);
  Laboratory laboratory(rig);
  SessionControl control;
  const SessionEnd end = capture(*folder, rig, spec_of(rig), *prepared, laboratory.devices,
                                 *laboratory.clock, control, {}, laboratory.reopen());
  EXPECT_EQ(end.outcome, SessionOutcome::stopped_early) << end.reason;
  EXPECT_THAT(end.reason, HasSubstr("lights = 2"));
  EXPECT_EQ(read_session_folder(folder->root).value().shots.size(), 3U);
}

}  // namespace
}  // namespace lightrig
