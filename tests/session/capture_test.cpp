// Stories of whole sessions on a simulated rig.
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdlib>
#include <fstream>
#include <map>
#include <set>

#include "daemon/session/durable_file.h"
#include "daemon/session/plan_json.h"
#include "daemon/session/reduction.h"
#include "tests/session/scene.h"
#include "tests/session/scratch.h"

namespace lightrig {
namespace {

namespace fs = std::filesystem;
using testing::HasSubstr;

class CaptureTest : public testing::Test {
 protected:
  SessionFolder create(const std::string& id = "s") const {
    auto folder = create_session(rig_, spec_of(rig_), small_plan(), id);
    if (!folder) ADD_FAILURE() << folder.error().message;
    return folder.value();
  }
  SessionEnd capture_whole(const SessionFolder& folder, std::vector<sim::Fault> faults = {}) const {
    Laboratory laboratory(rig_, std::move(faults));
    SessionControl control;
    const SessionEnd end = capture_in(folder, laboratory, control);
    EXPECT_TRUE(laboratory.world->lamp_power() == 0 || end.lamp_may_be_on) << end.reason;
    return end;
  }
  /// What an uninterrupted session leaves, computed once.
  const std::string& uninterrupted() {
    static const std::string text = [this] {
      const SessionFolder folder = create("uninterrupted");
      const SessionEnd end = capture_whole(folder);
      EXPECT_EQ(end.outcome, SessionOutcome::done) << end.reason;
      return comparable_text(folder);
    }();
    return text;
  }

  const Scratch scratch_;
  const Rig rig_ = small_rig(scratch_.path());
};

std::vector<std::string> events_of(const SessionFolder& folder) {
  std::vector<std::string> names;
  const Replay replay = replay_journal(folder.journal()).value();
  for (const JournalEvent& event : replay.events) {
    names.push_back(event.event);
  }
  return names;
}

TEST_F(CaptureTest, AWholeSessionIsCapturedJournaledAndReadBackFromItsFolderAlone) {
  const SessionFolder folder = create();
  const SessionEnd end = capture_whole(folder);
  ASSERT_EQ(end.outcome, SessionOutcome::done) << end.reason;
  EXPECT_FALSE(end.lamp_may_be_on);
  EXPECT_THAT(events_of(folder),
              testing::ElementsAre("opened", "started", "homed", "dark", "shot", "shot", "shot",
                                   "shot", "lamp_dark", "ended"));
  // Elsewhere, without the rig file it came from.
  const fs::path elsewhere = scratch_.path() / "elsewhere" / "copy";
  fs::create_directories(elsewhere.parent_path());
  fs::rename(folder.root, elsewhere);
  fs::remove(scratch_.path() / "rig.toml");
  const auto record = read_session_folder(elsewhere);
  ASSERT_TRUE(record) << record.error().message;
  EXPECT_EQ(record->state, "done");
  EXPECT_EQ(record->rig.text, rig_.text);
  EXPECT_EQ(record->darks.size(), 4U);
  ASSERT_EQ(record->shots.size(), 4U);
  EXPECT_EQ(std::ranges::count_if(record->shots, [](const auto& s) { return s.held_out; }), 1);
  for (const CapturedShot& shot : record->shots) {
    EXPECT_EQ(shot.frames.front().role, "ambient");
    EXPECT_GT(shot.elapsed_s, 0);
    const std::size_t lamp_on = shot.frames.size() - 1;
    EXPECT_EQ(lamp_on + shot.exposures_skipped.size() >= 4, true) << shot.name;
    for (const StoredFrame& frame : shot.frames) {
      EXPECT_EQ(sha256_hex(read_file(elsewhere / frame.file).value()), frame.sha256);
    }
  }
}

TEST_F(CaptureTest, TwoSessionsOfOneSeedAreEqualInBytes) {
  const SessionFolder folder = create("again");
  ASSERT_EQ(capture_whole(folder).outcome, SessionOutcome::done);
  EXPECT_EQ(comparable_text(folder), uninterrupted());
}

// Every frame that the journal vouches for was taken where and how it says, by the laboratory's own
// record: the right lamp state, the arm at rest at the planned position.
TEST_F(CaptureTest, NoFrameIsTakenInMotionOrInTheWrongPlace) {
  const SessionFolder folder = create();
  Laboratory laboratory(rig_);
  SessionControl control;
  ASSERT_EQ(capture_in(folder, laboratory, control).outcome, SessionOutcome::done);
  std::map<std::uint64_t, sim::ExposureRecord> by_id;
  for (const auto& record : laboratory.world->records()) by_id[record.frame_id] = record;
  const auto captured = captured_of(replay_journal(folder.journal()).value().events);
  for (const CapturedShot& shot : captured->shots) {
    const Shot& planned = small_plan().plan.shots[static_cast<std::size_t>(shot.index)];
    for (const StoredFrame& frame : shot.frames) {
      fs::path sidecar = folder.root / frame.file;
      sidecar.replace_extension(".json");
      const auto facts = nlohmann::json::parse(read_file(sidecar).value());
      const sim::ExposureRecord& truth = by_id.at(facts.at("frame_id"));
      EXPECT_FALSE(truth.moment.moving);
      EXPECT_EQ(truth.moment.lamp_power, frame.role == "ambient" ? 0.0 : 1.0) << frame.file;
      EXPECT_LT((truth.moment.light.p - planned.light.p).norm(), 1e-3) << frame.file;
    }
  }
}

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

TEST_F(CaptureTest, ARetakenShotIsTakenAnewAndTheOldFramesAreKept) {
  const SessionFolder folder = create();
  ASSERT_EQ(capture_whole(folder).outcome, SessionOutcome::done);
  EXPECT_EQ(retake_shot(folder, "L09").error().code, ErrorCode::not_found);
  ASSERT_TRUE(retake_shot(folder, "L02"));
  ASSERT_EQ(capture_whole(folder).outcome, SessionOutcome::done);
  int kept = 0;
  for (const auto& entry : fs::recursive_directory_iterator(folder.rejected())) {
    if (entry.path().extension() == ".exr") ++kept;
  }
  EXPECT_GE(kept, 2);
  EXPECT_EQ(read_session_folder(folder.root).value().shots.back().name, "L02");
}

TEST_F(CaptureTest, ASealedSessionIsListedFileByFileAndTakesNoMoreShots) {
  const SessionFolder folder = create();
  EXPECT_EQ(seal_session(folder).error().code, ErrorCode::refused);
  ASSERT_EQ(capture_whole(folder).outcome, SessionOutcome::done);
  ASSERT_TRUE(seal_session(folder));
  const std::string manifest = read_file(folder.manifest()).value();
  ASSERT_TRUE(seal_session(folder));
  EXPECT_EQ(read_file(folder.manifest()).value(), manifest);
  EXPECT_THAT(manifest,
              HasSubstr(sha256_hex(read_file(folder.journal()).value()) + "  journal.jsonl\n"));
  EXPECT_THAT(manifest, HasSubstr("  frames/L01/ambient.exr\n"));
  EXPECT_THAT(capture_whole(folder).reason, HasSubstr("sealed"));
}

TEST_F(CaptureTest, AnUnwritableSessionRootIsRefusedAndLeavesNothing) {
  Rig rig = rig_;
  ASSERT_TRUE(write_durably(scratch_.path() / "file", std::string("x")));
  rig.session_root = scratch_.path() / "file";
  const auto folder = create_session(rig, spec_of(rig_), small_plan(), "s");
  ASSERT_FALSE(folder);
  EXPECT_EQ(folder.error().code, ErrorCode::refused);
  EXPECT_THAT(folder.error().message, HasSubstr("file"));
  EXPECT_EQ(create_session(rig_, spec_of(rig_), small_plan(), "../up").error().code,
            ErrorCode::refused);
  create("twice");
  EXPECT_THAT(create_session(rig_, spec_of(rig_), small_plan(), "twice").error().message,
              HasSubstr("already"));
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
  const auto prepared = prepare(rig, spec_of(rig));
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

TEST(StopConfig, EndsTheSessionEarlyWhenEnoughLightsAreCaptured) {
  const Scratch scratch;
  const Rig rig = small_rig(scratch.path(), {{"[session]", "[stop]\nlights = 2\n\n[session]"}});
  const auto prepared = prepare(rig, spec_of(rig));
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
