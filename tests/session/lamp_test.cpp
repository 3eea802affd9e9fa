// A lamp that does not burn while everything that can be asked says it does: only the pictures
// tell, and the session asks them.
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <functional>
#include <map>
#include <random>

#include "daemon/session/durable_file.h"
#include "daemon/session/frame_file.h"
#include "daemon/session/light_witness.h"
#include "daemon/session/lit_sites.h"
#include "tests/session/capture_fixture.h"

namespace lightrig {
namespace {

using testing::AllOf;
using testing::Contains;
using testing::HasSubstr;
using testing::StartsWith;

class LampTest : public CaptureTest {
 protected:
  struct Told {
    SessionEnd end;
    std::vector<std::string> pauses, retries;  ///< the reason of each, as journaled
    int unseen = 0;
    bool always_dark = true;  ///< while paused
  };

  /// A session in which `happen` is told of every step, and `heal` of every beat of a pause.
  static Told run(
      const SessionFolder& folder, Laboratory& laboratory, const Prepared& prepared,
      const std::function<void(const SessionProgress&)>& happen,
      const std::function<void(int, SessionControl&)>& heal = [](int, SessionControl&) {}) {
    Told told;
    Prepared plan = prepared;
    SessionControl control;
    SessionListeners listeners;
    int beats = 0;
    listeners.progress = [&](const SessionProgress& progress) {
      if (!progress.activity.starts_with("paused: ")) return happen(progress);
      told.always_dark = told.always_dark && laboratory.world->lamp_power() == 0;
      if (++beats > 40) control.halt("the test waited long enough");
      heal(beats, control);
    };
    listeners.event = [&](const JournalEvent& event) {
      if (event.event == "paused") told.pauses.push_back(event.fields["reason"]);
      if (event.event == "retry") told.retries.push_back(event.fields["reason"]);
      told.unseen += event.event == "lamp_unseen" ? 1 : 0;
    };
    told.end = capture(folder, laboratory.rig, spec_of(laboratory.rig), plan, laboratory.devices,
                       *laboratory.clock, control, listeners, laboratory.reopen());
    return told;
  }

  /// Every stored lit frame was taken under a lamp that gave all its light, by the laboratory's own
  /// record of each picture.
  static void expect_only_lit(const SessionFolder& folder, const Laboratory& laboratory) {
    std::map<std::uint64_t, sim::SceneMoment> taken;
    for (const sim::ExposureRecord& record : laboratory.world->records())
      taken[record.content] = record.moment;
    const auto record = read_session_folder(folder.root);
    ASSERT_TRUE(record) << record.error().message;
    for (const CapturedShot& shot : record->shots)
      for (const StoredFrame& stored : shot.frames) {
        const auto frame = read_frame(folder.root / stored.file);
        ASSERT_TRUE(frame) << frame.error().message;
        const sim::SceneMoment& moment = taken.at(sim::content_of(frame->counts));
        const double given = moment.lamp_power * moment.lamp_gain;
        EXPECT_EQ(given, stored.role == "ambient" ? 0 : laboratory.rig.lamp.power) << stored.file;
      }
  }

  /// Plans the lights of small_plan() with these exposures alone.
  static Prepared plan_with(const std::vector<double>& exposures) {
    Prepared plan = small_plan();
    for (Shot& shot : plan.plan.shots) shot.exposures = exposures;
    return plan;
  }
};

// What the lamp gives from a step of the second light on, until that light is begun anew.
struct Accident {
  const char* name;
  const char* from;   ///< an activity's beginning
  double gives;       ///< of what it should
  const char* until;  ///< "" until the light is begun anew
};

class LampAccident : public LampTest, public testing::WithParamInterface<Accident> {};

TEST_P(LampAccident, IsSeenByThePicturesAndTheLightTakenAnewToTheSameBytes) {
  const Accident accident = GetParam();
  Laboratory laboratory(rig_);
  const SessionFolder folder = create();
  bool struck = false, healed = false;
  const Told told = run(folder, laboratory, small_plan(), [&](const SessionProgress& progress) {
    if (progress.shots_done != 1) return;
    const auto is = [&](const char* what) { return progress.activity.starts_with(what); };
    if (!struck && is(accident.from)) {
      struck = true;
      laboratory.world->set_lamp_gain(accident.gives);
    } else if (struck && !healed && is(*accident.until ? accident.until : "moving to")) {
      healed = true;
      laboratory.world->set_lamp_gain(1);
    }
  });
  EXPECT_TRUE(struck);
  EXPECT_EQ(told.end.outcome, SessionOutcome::done) << told.end.reason;
  EXPECT_TRUE(told.pauses.empty());
  ASSERT_EQ(told.retries.size(), 1U);
  EXPECT_THAT(told.retries[0], StartsWith("lamp: the frame of "));
  expect_only_lit(folder, laboratory);
  EXPECT_EQ(comparable_text(folder), uninterrupted());
}

INSTANTIATE_TEST_SUITE_P(
    Of, LampAccident,
    testing::Values(Accident{"NoLightFromTheFirst", "metering", 0, ""},
                    Accident{"DeathAfterMetering", "exposing", 0, ""},
                    Accident{"DimmingAfterMetering", "exposing", 0.8, ""},
                    Accident{"DeathBeforeTheMeteringFrameOnly", "metering", 0, "exposing"},
                    Accident{"DimMeteringFrameOnly", "metering", 0.7, "exposing"}),
    [](const auto& accident) { return std::string(accident.param.name); });

TEST_F(LampTest, ThatStaysDarkPausesTheSessionUntilAPersonHasMendedIt) {
  Laboratory laboratory(rig_);
  const SessionFolder folder = create();
  bool struck = false;
  const Told told = run(
      folder, laboratory, small_plan(),
      [&](const SessionProgress& progress) {
        if (struck || progress.shots_done != 1 || !progress.activity.starts_with("exposing"))
          return;
        struck = true;
        laboratory.world->set_lamp_gain(0);
      },
      [&](int beat, SessionControl& control) {
        if (beat == 2) control.resume();  // too early: the lamp is as it was
        if (beat != 6) return;
        laboratory.world->set_lamp_gain(1);
        control.resume();
      });
  EXPECT_EQ(told.end.outcome, SessionOutcome::done) << told.end.reason;
  ASSERT_EQ(told.pauses.size(), 2U);
  for (const std::string& pause : told.pauses)
    EXPECT_THAT(pause, AllOf(StartsWith("lamp: "), HasSubstr("possibly failed"),
                             HasSubstr("shows no light of it")));
  EXPECT_TRUE(told.always_dark);
  expect_only_lit(folder, laboratory);
  EXPECT_EQ(comparable_text(folder), uninterrupted());
}

TEST_F(LampTest, ThatFailsAfterAResumeOfNothingStillWaitsForAPerson) {
  Laboratory laboratory(rig_);
  const SessionFolder folder = create();
  SessionControl control;
  int beats = 0;
  SessionListeners listeners;
  listeners.progress = [&](const SessionProgress& progress) {
    if (progress.activity.starts_with("paused: ")) {
      if (++beats == 3) control.halt("nobody came");
    } else if (progress.shots_done == 1 && progress.activity.starts_with("exposing")) {
      control.resume();  // nothing is paused
      laboratory.world->set_lamp_gain(0);
    }
  };
  int pauses = 0;
  listeners.event = [&](const JournalEvent& event) { pauses += event.event == "paused" ? 1 : 0; };
  const SessionEnd end = capture_in(folder, laboratory, control, listeners);
  EXPECT_EQ(end.outcome, SessionOutcome::paused) << end.reason;
  EXPECT_THAT(end.reason, HasSubstr("nobody came"));
  EXPECT_EQ(pauses, 1);
}

// A bracket of one exposure has nothing to be held against: one more frame, which nobody keeps,
// tells whether the lamp burnt to its end.
TEST_F(LampTest, ThatDimsUnderTheOnlyExposureIsSeenByAFrameThatNobodyKeeps) {
  Laboratory laboratory(
      small_rig(scratch_.path(), {{"[80e-6, 1.28e-3, 20.48e-3, 327.68e-3]", "[1.28e-3]"}}));
  const Prepared plan = plan_with({1.28e-3});
  const auto folder = create_session(laboratory.rig, spec_of(laboratory.rig), plan, "one");
  ASSERT_TRUE(folder) << folder.error().message;
  bool struck = false;
  const Told told = run(*folder, laboratory, plan, [&](const SessionProgress& progress) {
    if (progress.shots_done != 1) return;
    if (!struck && progress.activity.starts_with("metering")) {
      struck = true;
      laboratory.world->set_lamp_gain(0.6);
    } else if (progress.activity.starts_with("looking whether")) {
      laboratory.world->set_lamp_gain(1);
    }
  });
  EXPECT_EQ(told.end.outcome, SessionOutcome::done) << told.end.reason;
  EXPECT_THAT(told.retries, testing::ElementsAre(StartsWith("lamp: the frame of 0.00128 s")));
  expect_only_lit(*folder, laboratory);
}

// Light that no exposure can show above its noise is not a lamp that failed. It is said.
TEST_F(LampTest, InAViewTooDarkToTellIsNotAccusedAndThatIsSaid) {
  Laboratory laboratory(small_rig(
      scratch_.path(), {{"response_e_m2_sr_per_j = 1.6e5", "response_e_m2_sr_per_j = 1.6"}}));
  const Told told = run(create(), laboratory, small_plan(), [](const SessionProgress&) {});
  EXPECT_EQ(told.end.outcome, SessionOutcome::done) << told.end.reason;
  EXPECT_EQ(told.unseen, 4);
  EXPECT_TRUE(told.retries.empty());
  EXPECT_TRUE(told.pauses.empty());
}

// The darkest and the shiniest there are; the basis has seen neither, nor anything of their kind.
TEST_F(LampTest, OnSamplesUnlikeAnyOfTheBasisIsNotAccused) {
  for (const std::string material : {"velvet-black", "silver-mirror"}) {
    Laboratory laboratory(
        small_rig(scratch_.path(), {{"polystyrene-maroon", material},
                                    {"ambient_w_per_m2_sr = 0.002", "ambient_w_per_m2_sr = 0.2"}}));
    const Told told =
        run(create(material), laboratory, small_plan(), [](const SessionProgress&) {});
    EXPECT_EQ(told.end.outcome, SessionOutcome::done) << material << told.end.reason;
    EXPECT_THAT(told.retries, testing::IsEmpty()) << material;
    EXPECT_THAT(told.pauses, testing::IsEmpty()) << material;
  }
}

/// Frames of a scene of one brightness, by the sensor's own terms: Poisson's and Gauss's noise, as
/// the standard library draws them.
class NoisyFrames {
 public:
  NoisyFrames(const Rig& rig, std::uint64_t seed) : rig_(rig), chance_(seed) {}
  /// `rate` [e⁻/s] at every site.
  Frame take(double rate, double exposure) {
    const SensorModel& sensor = rig_.camera.sensor;
    Frame frame;
    frame.exposure = exposure;
    frame.counts.width = rig_.camera.model.width;
    frame.counts.height = rig_.camera.model.height;
    const auto sites = static_cast<std::size_t>(frame.counts.width) *
                       static_cast<std::size_t>(frame.counts.height);
    std::poisson_distribution<int> photons((rate + sensor.dark_current) * exposure);
    std::normal_distribution<double> read(0, sensor.read_noise);
    for (std::size_t i = 0; i < sites; ++i) {
      const double electrons = std::min(photons(chance_) + read(chance_), sensor.full_well);
      const long count = std::lround(sensor.black_level + electrons / sensor.gain);
      frame.counts.counts.push_back(
          static_cast<std::uint16_t>(std::clamp(count, 0L, long{sensor.white_level()})));
    }
    return frame;
  }

 private:
  const Rig& rig_;
  std::mt19937_64 chance_;
};

class LightWitnessTest : public LampTest {
 protected:
  LightWitness witness(const Frame& ambient) const {
    return {rig_, spec_, small_plan(), 0, lit_sites(rig_, spec_, small_plan(), 0), ambient};
  }
  const SessionSpec spec_ = spec_of(rig_);
};

TEST_F(LightWitnessTest, NeverContradictsALampThatBurnsAndAlwaysOneThatLosesAFifth) {
  std::mt19937_64 chance(7);
  int told = 0;
  for (std::uint64_t seed = 0; seed < 60; ++seed) {
    NoisyFrames frames(rig_, seed);
    // From darker than any material of the basis to what fills the well, in a room dark or bright.
    const double rate = std::exp(std::uniform_real_distribution<>(7, 14)(chance));
    const double room = rate * std::uniform_real_distribution<>(0, 0.3)(chance);
    LightWitness steady = witness(frames.take(room, 20.48e-3));
    LightWitness dimmed = witness(frames.take(room, 20.48e-3));
    for (const double exposure : {1.28e-3, 80e-6, 20.48e-3, 327.68e-3}) {
      const auto why = steady.contradiction(frames.take(room + rate, exposure));
      EXPECT_FALSE(why) << seed << ": " << *why;
    }
    // A fifth stands out where a site gathers some hundreds of electrons and is not full.
    if (rate * 1.28e-3 < 200 || rate * 2.56e-3 > 6000) continue;
    EXPECT_FALSE(dimmed.contradiction(frames.take(room + rate, 1.28e-3)));
    EXPECT_TRUE(dimmed.contradiction(frames.take(room + 0.8 * rate, 2.56e-3))) << rate;
    ++told;
  }
  EXPECT_GT(told, 10);
}

}  // namespace
}  // namespace lightrig
