#pragma once

#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "daemon/session/journal.h"
#include "tests/session/scene.h"
#include "tests/session/scratch.h"

namespace lightrig {

/// Whole sessions on the small simulated rig, in a folder of their own.
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

inline std::vector<std::string> events_of(const SessionFolder& folder) {
  std::vector<std::string> names;
  const Replay replay = replay_journal(folder.journal()).value();
  for (const JournalEvent& event : replay.events) {
    names.push_back(event.event);
  }
  return names;
}

}  // namespace lightrig
