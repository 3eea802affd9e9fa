// Sessions that a condition pauses: packets that go astray, a hot lamp or camera, a lamp that does
// not shine as it did. Each goes on once the condition is gone, and comes out the same.
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <functional>

#include "tests/session/capture_fixture.h"

namespace lightrig {
namespace {

using testing::HasSubstr;
using testing::StartsWith;

class ConditionTest : public CaptureTest {
 protected:
  Rig watched(const std::string& tables) const {
    return small_rig(scratch_.path(), {{"[bracket]", tables + "\n[bracket]"}});
  }

  struct Told {
    SessionEnd end;
    std::vector<std::string> pauses;  ///< the reason of each, as journaled
    int beats = 0;                    ///< looks while paused
    bool always_dark = true;
  };

  /// A session in which `happen` is told of every step and `heal` of every beat of a pause.
  Told run(const SessionFolder& folder, Laboratory& laboratory,
           const std::function<void(const SessionProgress&)>& happen,
           const std::function<void(int beat, SessionControl&)>& heal) const {
    Told told;
    SessionControl control;
    SessionListeners listeners;
    listeners.progress = [&](const SessionProgress& progress) {
      if (!progress.activity.starts_with("paused: ")) return happen(progress);
      told.always_dark = told.always_dark && laboratory.world->lamp_power() == 0;
      if (++told.beats > 400) control.halt("the test waited long enough");
      heal(told.beats, control);
    };
    listeners.event = [&](const JournalEvent& event) {
      if (event.event == "paused") {
        EXPECT_EQ(event.fields["why"], "condition");
        told.pauses.push_back(event.fields["reason"].get<std::string>());
      }
    };
    told.end = capture_in(folder, laboratory, control, listeners);
    return told;
  }
};

TEST_F(ConditionTest, RepeatedPacketsPauseItBetweenLightsUntilDarkFramesComeCleanly) {
  Laboratory laboratory(
      watched("[pause.packet_loss]\npause_above_per_frame = 2\n"
              "resume_below_per_frame = 0.5\nover_frames = 3\n"
              "resume_by_itself = true\n"));
  const SessionFolder folder = create();
  const Told told = run(
      folder, laboratory,
      [&](const SessionProgress& progress) {
        if (progress.activity.starts_with("metering L0") && progress.shots_done == 1)
          laboratory.world->set_packet_weather({.resent_per_frame = 9});
      },
      [&](int beat, SessionControl&) {
        if (beat == 2) laboratory.world->set_packet_weather({});
      });
  EXPECT_EQ(told.end.outcome, SessionOutcome::done) << told.end.reason;
  ASSERT_EQ(told.pauses.size(), 1U);
  EXPECT_THAT(told.pauses[0], HasSubstr("packets a frame"));
  EXPECT_GE(told.beats, 4);  // three clean frames, the first at the second beat
  EXPECT_TRUE(told.always_dark);
  EXPECT_EQ(comparable_text(folder), uninterrupted());
}

TEST_F(ConditionTest, FramesThatLostPacketsForGoodPauseItInsteadOfEndingIt) {
  Laboratory laboratory(
      watched("[pause.packet_loss]\npause_above_per_frame = 2\n"
              "resume_below_per_frame = 0.5\nover_frames = 3\n"));
  const SessionFolder folder = create();
  bool resumed = false;
  const Told told = run(
      folder, laboratory,
      [&](const SessionProgress& progress) {
        if (!resumed && progress.activity.starts_with("exposing") && progress.shots_done == 1)
          laboratory.world->set_packet_weather({.lost_per_frame = 12});
      },
      [&](int beat, SessionControl& control) {
        if (beat == 1) control.resume();  // too early: packets are still lost
        if (beat == 2) laboratory.world->set_packet_weather({});
        if (beat == 6) {
          resumed = true;
          control.resume();
        }
      });
  EXPECT_EQ(told.end.outcome, SessionOutcome::done) << told.end.reason;
  EXPECT_EQ(told.pauses.size(), 1U);
  EXPECT_GE(told.beats, 6);  // it did not go on by itself
  EXPECT_TRUE(told.always_dark);
  EXPECT_EQ(comparable_text(folder), uninterrupted());
}

TEST_F(ConditionTest, AHotLampOrCameraPausesItUntilItHasCooledBelowTheLowerBound) {
  for (const std::string whose : {"lamp", "camera"}) {
    Laboratory laboratory(
        watched(fmt::format("[pause.{}_temperature]\npause_above_c = 60\n"
                            "resume_below_c = 50\nresume_by_itself = true\n",
                            whose)));
    const SessionFolder folder = create(whose);
    const auto heat = [&](double celsius) {
      laboratory.world->set_temperatures(whose == "lamp" ? celsius : 25,
                                         whose == "camera" ? celsius : 25);
    };
    bool heated = false;
    const Told told = run(
        folder, laboratory,
        [&](const SessionProgress& progress) {
          if (heated || progress.shots_done != 1) return;
          heated = true;
          heat(72);
        },
        [&](int beat, SessionControl&) {
          if (beat == 1) heat(55);  // below the upper bound: still held
          if (beat == 3) heat(49);
        });
    EXPECT_EQ(told.end.outcome, SessionOutcome::done) << told.end.reason;
    ASSERT_EQ(told.pauses.size(), 1U) << whose;
    EXPECT_THAT(told.pauses[0], StartsWith("the " + whose + " is at 72.0 °C"));
    EXPECT_GE(told.beats, 3);
    EXPECT_LE(told.beats, 5);
    EXPECT_TRUE(told.always_dark);
    EXPECT_EQ(comparable_text(folder), uninterrupted()) << whose;
  }
}

TEST_F(ConditionTest, ALampThatFadesIsSeenByTheFirstLightsFrameAndHoldsItUntilItShinesAsBefore) {
  Laboratory laboratory(
      watched("[pause.lamp_drift]\npause_above_percent = 4\n"
              "resume_below_percent = 1\nevery_lights = 2\n"));
  const SessionFolder folder = create();
  bool faded = false;
  const Told told = run(
      folder, laboratory,
      [&](const SessionProgress& progress) {
        // After the second light's frames are taken: no frame that is kept is dimmed.
        if (faded || !progress.activity.starts_with("looking at the lamp")) return;
        faded = true;
        laboratory.world->set_lamp_gain(0.93);
      },
      [&](int beat, SessionControl& control) {
        if (beat == 1) control.resume();  // not mended: stays paused
        if (beat == 2) laboratory.world->set_lamp_gain(0.995);
        if (beat == 2) control.resume();
      });
  EXPECT_EQ(told.end.outcome, SessionOutcome::done) << told.end.reason;
  ASSERT_EQ(told.pauses.size(), 1U);
  EXPECT_THAT(told.pauses[0], HasSubstr("the lamp gives 93."));
  EXPECT_THAT(told.pauses[0], HasSubstr("captured since the look before: L"));
  EXPECT_TRUE(told.always_dark);
  int looks = 0, unlike = 0;
  const Replay replay = replay_journal(folder.journal()).value();
  for (const JournalEvent& event : replay.events) {
    if (event.event != "reference") continue;
    ++looks;
    if (event.fields["like"].get<bool>()) continue;
    ++unlike;
    // The ambient light, which has not faded, is in the frames too: a thousandth.
    EXPECT_NEAR(event.fields["measured"]["ratio"].get<double>(), 0.93, 0.005);
  }
  EXPECT_EQ(looks, 4);  // the drift, a word too early, the mended lamp, and the end
  EXPECT_EQ(unlike, 2);
}

TEST_F(ConditionTest, WhatIsWatchedAndFineChangesNoFrame) {
  Laboratory laboratory(
      watched("[pause.packet_loss]\npause_above_per_frame = 1\n"
              "resume_below_per_frame = 0\n"
              "[pause.lamp_drift]\npause_above_percent = 4\n"
              "resume_below_percent = 1\nevery_lights = 1\n"
              "[pause.lamp_temperature]\npause_above_c = 60\n"
              "resume_below_c = 50\n"));
  const SessionFolder folder = create();
  const Told told = run(
      folder, laboratory, [](const SessionProgress&) {}, [](int, SessionControl&) {});
  EXPECT_EQ(told.end.outcome, SessionOutcome::done) << told.end.reason;
  EXPECT_TRUE(told.pauses.empty());
  EXPECT_EQ(comparable_text(folder), uninterrupted());
}

TEST_F(ConditionTest, AStopWhilePausedEndsItWithWhatIsCaptured) {
  Laboratory laboratory(
      watched("[pause.lamp_temperature]\npause_above_c = 60\n"
              "resume_below_c = 50\n"));
  const SessionFolder folder = create();
  const Told told = run(
      folder, laboratory,
      [&](const SessionProgress& progress) {
        if (progress.shots_done == 1) laboratory.world->set_temperatures(80, 25);
      },
      [](int beat, SessionControl& control) {
        if (beat != 2) return;
        control.stop_after_shot();
        control.resume();
      });
  EXPECT_EQ(told.end.outcome, SessionOutcome::stopped_early) << told.end.reason;
  EXPECT_GE(read_session_folder(folder.root).value().shots.size(), 1U);
}

}  // namespace
}  // namespace lightrig
