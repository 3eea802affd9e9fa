// Stories of whole sessions on a simulated rig.
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <map>

#include "daemon/session/durable_file.h"
#include "daemon/session/session_folder.h"
#include "tests/session/capture_fixture.h"

namespace lightrig {
namespace {

namespace fs = std::filesystem;
using testing::HasSubstr;

TEST_F(CaptureTest, AWholeSessionIsCapturedJournaledAndReadBackFromItsFolderAlone) {
  const SessionFolder folder = create();
  const SessionEnd end = capture_whole(folder);
  ASSERT_EQ(end.outcome, SessionOutcome::done) << end.reason;
  EXPECT_FALSE(end.lamp_may_be_on);
  EXPECT_THAT(events_of(folder),
              testing::ElementsAre("opened", "started", "homed", "dark", "shot", "shot", "shot",
                                   "shot", "pose", "lamp_dark", "ended"));
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
    EXPECT_GE(lamp_on, 1U) << shot.name;
    EXPECT_GE(lamp_on + shot.exposures_skipped.size(), 4U) << shot.name;
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

TEST_F(CaptureTest, ARefusalThatNothingMendsEndsItAndIsCalledNoRetry) {
  const SessionFolder folder = create();
  const SessionEnd end =
      capture_whole(folder, {{sim::DeviceCall::camera_expose, 6, sim::FaultEffect::refused}});
  EXPECT_EQ(end.outcome, SessionOutcome::faulted) << end.reason;
  EXPECT_THAT(events_of(folder), testing::Not(testing::Contains("retry")));
  // A time-out is asked again, and said to be.
  const SessionFolder other = create("other");
  EXPECT_EQ(capture_whole(other, {{sim::DeviceCall::camera_expose, 6, sim::FaultEffect::timed_out}})
                .outcome,
            SessionOutcome::done);
  EXPECT_THAT(events_of(other), testing::Contains("retry"));
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

}  // namespace
}  // namespace lightrig
