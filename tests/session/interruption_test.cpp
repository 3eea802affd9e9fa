// Sessions that are cut, fail, pause, stop or run out of disk: the same bytes come out, or the
// reason.
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdlib>
#include <fstream>
#include <set>

#include "daemon/session/durable_file.h"
#include "tests/session/capture_fixture.h"

namespace lightrig {
namespace {

namespace fs = std::filesystem;
using testing::HasSubstr;

TEST_F(CaptureTest, TheJournalMayBeCutAtAnyLineAndMostBytesAndTheSessionComesOutTheSame) {
  const SessionFolder whole = create("whole");
  ASSERT_EQ(capture_whole(whole).outcome, SessionOutcome::done);
  const std::string journal = read_file(whole.journal()).value();
  std::set<std::size_t> cuts{0};
  for (std::size_t at = 0; at < journal.size(); ++at) {
    if (journal[at] == '\n') cuts.insert({at, at + 1, at - 200 < at ? at - 200 : at});
  }
  for (const std::size_t cut : cuts) {
    const SessionFolder folder{scratch_.path() / fmt::format("cut{}", cut)};
    fs::copy(whole.root, folder.root, fs::copy_options::recursive);
    fs::resize_file(folder.journal(), cut);
    const SessionEnd end = capture_whole(folder);
    ASSERT_EQ(end.outcome, SessionOutcome::done) << "cut at " << cut << ": " << end.reason;
    EXPECT_TRUE(comparable_text(folder) == uninterrupted()) << "cut at " << cut;
    fs::remove_all(folder.root);
  }
}

class EveryCallMayFail : public CaptureTest,
                         public testing::WithParamInterface<sim::FaultEffect> {};

TEST_P(EveryCallMayFail, OnceAndTheSessionCompletesOrSaysWhyNotWithTheLampDark) {
  Laboratory counting(rig_);
  {
    SessionControl control;
    ASSERT_EQ(capture_in(create("count"), counting, control).outcome, SessionOutcome::done);
  }
  const std::uint64_t calls = counting.script->calls(sim::DeviceCall::any);
  ASSERT_GT(calls, 50U);
  int completed = 0, ended = 0;
  // Every ninth call for each of the nine effects, all calls between them; every one for each when
  // asked (some minutes).
  const bool thorough = std::getenv("LIGHTRIG_THOROUGH") != nullptr;
  const std::uint64_t first = thorough ? 1 : 1 + static_cast<std::uint64_t>(GetParam());
  for (std::uint64_t nth = first; nth <= calls; nth += thorough ? 1 : 9) {
    const SessionFolder folder = create(fmt::format("n{}", nth));
    Laboratory laboratory(rig_, {{sim::DeviceCall::any, nth, GetParam()}});
    SessionControl control;
    const SessionEnd end = capture_in(folder, laboratory, control);
    const std::string said = fmt::format("call {}: {}", nth, end.reason);
    EXPECT_TRUE(laboratory.world->lamp_power() == 0 || end.lamp_may_be_on) << said;
    if (end.outcome == SessionOutcome::done) {
      ++completed;
      EXPECT_TRUE(comparable_text(folder) == uninterrupted()) << said;
    } else {
      ++ended;
      EXPECT_EQ(end.outcome, SessionOutcome::faulted) << said;
      EXPECT_FALSE(end.reason.empty());
      // A person looks at it and resumes: nothing is lost.
      EXPECT_EQ(capture_whole(folder).outcome, SessionOutcome::done) << said;
      EXPECT_TRUE(comparable_text(folder) == uninterrupted()) << said;
    }
    fs::remove_all(folder.root);
  }
  RecordProperty("completed", completed);
  RecordProperty("ended", ended);
  // What can be put right by trying again is. A refusal wants a person (and a call that cannot go
  // wrong in another way refuses).
  if (GetParam() == sim::FaultEffect::timed_out || GetParam() == sim::FaultEffect::answer_lost ||
      GetParam() == sim::FaultEffect::disconnected) {
    EXPECT_EQ(ended, 0);
  }
}

INSTANTIATE_TEST_SUITE_P(Effects, EveryCallMayFail,
                         testing::Values(sim::FaultEffect::timed_out, sim::FaultEffect::answer_lost,
                                         sim::FaultEffect::disconnected, sim::FaultEffect::refused,
                                         sim::FaultEffect::ignored, sim::FaultEffect::short_move,
                                         sim::FaultEffect::wrong_exposure,
                                         sim::FaultEffect::stale_frame,
                                         sim::FaultEffect::wrong_size),
                         [](const auto& effect) {
                           return std::string(sim::name_of(effect.param));
                         });

// Opened anew, a gantry would have to be homed again with some controllers.
TEST_F(CaptureTest, ALampLostOnAWireOfItsOwnIsOpenedAloneAndTheSessionComesOutTheSame) {
  for (const std::uint64_t nth : {2U, 5U, 7U}) {
    const SessionFolder folder = create(fmt::format("lamp{}", nth));
    Laboratory laboratory(rig_, {{sim::DeviceCall::lamp_set, nth, sim::FaultEffect::disconnected}});
    SessionControl control;
    const SessionEnd end = capture_in(folder, laboratory, control);
    EXPECT_EQ(end.outcome, SessionOutcome::done) << end.reason;
    EXPECT_EQ(laboratory.asked_to_reopen, std::vector<Reopen>{Reopen::lamp}) << nth;
    EXPECT_EQ(laboratory.script->calls(sim::DeviceCall::gantry_home), 1U);
    EXPECT_EQ(comparable_text(folder), uninterrupted());
  }
}

TEST_F(CaptureTest, AnAbortEndsItDarkAndASecondCallCompletesIt) {
  const SessionFolder folder = create();
  {
    Laboratory laboratory(rig_);
    SessionControl control;
    SessionListeners listeners;
    listeners.progress = [&](const SessionProgress& progress) {
      if (progress.shots_done == 1 && progress.activity.starts_with("exposing")) {
        control.abort("operator saw smoke");
      }
    };
    const SessionEnd end = capture_in(folder, laboratory, control, listeners);
    EXPECT_EQ(end.outcome, SessionOutcome::aborted);
    EXPECT_THAT(end.reason, HasSubstr("operator saw smoke"));
    EXPECT_EQ(laboratory.world->lamp_power(), 0);
  }
  EXPECT_EQ(read_session_folder(folder.root).value().state, "aborted");
  EXPECT_EQ(capture_whole(folder).outcome, SessionOutcome::done);
  EXPECT_EQ(comparable_text(folder), uninterrupted());
  EXPECT_THAT(events_of(folder), testing::Contains("reference"));
}

TEST_F(CaptureTest, APauseDarkensTheLampAndResumingGoesOn) {
  const SessionFolder folder = create();
  Laboratory laboratory(rig_);
  SessionControl control;
  SessionListeners listeners;
  bool asked = false;
  double lamp_while_paused = -1;
  listeners.progress = [&](const SessionProgress& progress) {
    if (!asked && progress.shots_done == 1 && progress.activity.starts_with("exposing")) {
      asked = true;
      control.pause("lunch");
    } else if (progress.activity.starts_with("paused: lunch")) {
      lamp_while_paused = laboratory.world->lamp_power();
      control.resume();
    }
  };
  const SessionEnd end = capture_in(folder, laboratory, control, listeners);
  EXPECT_EQ(end.outcome, SessionOutcome::done) << end.reason;
  EXPECT_EQ(lamp_while_paused, 0);
  EXPECT_EQ(comparable_text(folder), uninterrupted());
  EXPECT_THAT(events_of(folder), testing::IsSupersetOf({"paused", "resumed"}));
}

TEST_F(CaptureTest, StopAfterShotKeepsTheShotInProgress) {
  const SessionFolder folder = create();
  Laboratory laboratory(rig_);
  SessionControl control;
  SessionListeners listeners;
  listeners.progress = [&](const SessionProgress& progress) {
    if (progress.activity.starts_with("metering")) control.stop_after_shot();
  };
  const SessionEnd end = capture_in(folder, laboratory, control, listeners);
  EXPECT_EQ(end.outcome, SessionOutcome::stopped_early) << end.reason;
  EXPECT_EQ(read_session_folder(folder.root).value().shots.size(), 1U);
}

TEST_F(CaptureTest, StoppedBeforeAnyLightItWaitsToBeResumed) {
  const SessionFolder folder = create();
  Laboratory laboratory(rig_);
  SessionControl control;
  SessionListeners listeners;
  listeners.progress = [&](const SessionProgress& progress) {
    if (progress.activity.starts_with("dark frame")) control.stop_after_shot();
  };
  const SessionEnd end = capture_in(folder, laboratory, control, listeners);
  EXPECT_EQ(end.outcome, SessionOutcome::paused) << end.reason;
  EXPECT_EQ(read_session_folder(folder.root).value().shots.size(), 0U);
  EXPECT_EQ(capture_whole(folder).outcome, SessionOutcome::done);
  EXPECT_EQ(comparable_text(folder), uninterrupted());
}

TEST_F(CaptureTest, AnOpenDoorPausesAndASwappedSampleIsNoticedOnResuming) {
  const SessionFolder folder = create();
  Laboratory laboratory(rig_);
  SessionControl control;
  SessionListeners listeners;
  bool opened = false, halted = false;
  listeners.progress = [&](const SessionProgress& progress) {
    if (!opened && progress.shots_done == 1 && progress.activity.starts_with("exposing")) {
      opened = true;
      laboratory.world->set_interlock("door", true);
    } else if (progress.activity.starts_with("paused: interlock open: door")) {
      EXPECT_EQ(laboratory.world->lamp_power(), 0);
      laboratory.world->set_interlock("door", false);
      control.resume();
    } else if (progress.shots_done == 3 && !halted) {
      halted = true;
      control.halt("the service stops");
    }
  };
  const SessionEnd end = capture_in(folder, laboratory, control, listeners);
  EXPECT_EQ(end.outcome, SessionOutcome::paused) << end.reason;
  EXPECT_TRUE(opened && halted);

  const Scratch other;
  Laboratory swapped(small_rig(other.path(), {{"polystyrene-maroon", "gold-satin"}}));
  SessionControl again;
  const SessionEnd refused = capture_in(folder, swapped, again);
  EXPECT_EQ(refused.outcome, SessionOutcome::paused);
  EXPECT_THAT(refused.reason, HasSubstr("the scene is not what it was"));
  EXPECT_EQ(capture_whole(folder).outcome, SessionOutcome::done);
  EXPECT_EQ(comparable_text(folder), uninterrupted());
}

TEST_F(CaptureTest, AFullDiskPausesDarkAndGoesOnWhenThereIsSpace) {
  const SmallDisk disk(8 << 20);
  if (!disk.mounted()) GTEST_SKIP() << "mounting a small tmpfs needs root";
  Rig rig = rig_;
  rig.session_root = disk.path();
  const auto folder = create_session(rig, spec_of(rig_), small_plan(), "s");
  ASSERT_TRUE(folder) << folder.error().message;
  Laboratory laboratory(rig_);
  SessionControl control;
  SessionListeners listeners;
  bool filled = false;
  int beats = 0;
  listeners.progress = [&](const SessionProgress& progress) {
    if (!filled && progress.activity.starts_with("metering")) {
      filled = true;
      std::ofstream ballast(disk.path() / "ballast", std::ios::binary);
      const std::string block(4096, 'x');
      while (ballast << block << std::flush) {
      }
    } else if (progress.activity.starts_with("paused: the disk of")) {
      EXPECT_EQ(laboratory.world->lamp_power(), 0);
      if (++beats == 2) fs::remove(disk.path() / "ballast");
    }
  };
  const SessionEnd end = capture_in(*folder, laboratory, control, listeners);
  EXPECT_EQ(end.outcome, SessionOutcome::done) << end.reason;
  EXPECT_GE(beats, 2);
  EXPECT_EQ(comparable_text(*folder), uninterrupted());
}

}  // namespace
}  // namespace lightrig
