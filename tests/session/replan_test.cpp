// A light that loses rows changes what is captured after it.
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <numeric>
#include <random>
#include <set>

#include "core/map_solver.h"
#include "daemon/session/durable_file.h"
#include "daemon/session/plan_json.h"
#include "daemon/session/plan_shots.h"
#include "daemon/session/replan.h"
#include "tests/session/replan_lab.h"

namespace lightrig {
namespace {

namespace fs = std::filesystem;
using testing::HasSubstr;

/// The plan of five lights, computed once.
const Prepared& five_light_plan() {
  static const Prepared prepared = [] {
    const Scratch scratch;
    const Rig rig = small_rig(scratch.path(), {five_lights});
    return prepare(rig, spec_of(rig)).value();
  }();
  return prepared;
}

Eigen::Vector3d ball_before_shot(int shot) {
  return ball_before(five_light_plan().plan.shots[static_cast<std::size_t>(shot)].light);
}

/// The first fitted light of the way that a ball can take without standing in the camera's view.
int first_light() {
  const Plan& plan = five_light_plan().plan;
  const Scratch scratch;
  const CameraModel camera = small_rig(scratch.path(), {five_lights}).camera.model;
  for (const int index : plan.visit_order) {
    const bool fitted = !plan.shots[static_cast<std::size_t>(index)].held_out;
    if (fitted && !in_view(camera, ball_before_shot(index))) return index;
  }
  return -1;
}

/// A rig before whose first light a ball stands that nothing but the simulated laboratory knows.
Rig blocked_rig(const fs::path& folder, bool replan) {
  const Eigen::Vector3d at = ball_before_shot(first_light());
  return small_rig(folder, {five_lights, with_ball(at), with_replan(replan)});
}

/// As after a restart: the plan is what the folder says it has become.
Prepared as_resumed(const SessionFolder& folder) {
  Prepared prepared = five_light_plan();
  const SessionRecord record = read_session_folder(folder.root).value();
  prepared.plan = record.plan;
  for (Shot& shot : prepared.plan.shots) {
    shot.light = prepared.candidates[static_cast<std::size_t>(shot.candidate)].light;
  }
  return prepared;
}

SessionEnd capture_blocked(const SessionFolder& folder, const Rig& rig) {
  Laboratory laboratory(rig);
  SessionControl control;
  Prepared prepared = as_resumed(folder);
  return capture(folder, rig, spec_of(rig), prepared, laboratory.devices, *laboratory.clock,
                 control, {}, laboratory.reopen());
}

std::string replans_text(const SessionFolder& folder) {
  std::string text;
  for (const JournalEvent& event : replans_of(folder)) text += event.fields.dump() + "\n";
  return text;
}

class Replanning : public testing::Test {
 protected:
  SessionFolder session(const Rig& rig, const std::string& id) {
    return create_session(rig, spec_of(rig), five_light_plan(), id).value();
  }
  const Scratch scratch_, other_;
};

TEST_F(Replanning, AfterALightThatWasBlockedOthersAreTaken) {
  const Rig changing = blocked_rig(scratch_.path(), true),
            fixed = blocked_rig(other_.path(), false);
  const SessionFolder replanned = session(changing, "r"), as_planned = session(fixed, "p");
  ASSERT_EQ(capture_blocked(replanned, changing).outcome, SessionOutcome::done);
  ASSERT_EQ(capture_blocked(as_planned, fixed).outcome, SessionOutcome::done);
  ASSERT_FALSE(replans_of(replanned).empty());
  EXPECT_TRUE(replans_of(as_planned).empty());

  const JournalEvent event = replans_of(replanned).front();
  EXPECT_EQ(event.fields["after"], shot_name(five_light_plan().plan, first_light()));
  EXPECT_THAT(event.fields["reason"].get<std::string>(), HasSubstr("bins lost"));
  EXPECT_GT(event.fields["lost"]["missing"].get<int>(),
            event.fields["lost"]["planned_bins"].get<int>() / 10);
  EXPECT_LT(event.fields["predicted_error_percent"]["replanned"].get<double>(),
            event.fields["predicted_error_percent"]["as_planned"].get<double>());

  // What was captured is what the plan has become, and the light that tests it is untouched.
  const SessionRecord record = read_session_folder(replanned.root).value();
  const SessionRecord before = read_session_folder(as_planned.root).value();
  ASSERT_EQ(record.shots.size(), before.shots.size());
  std::set<int> candidates;
  for (const Shot& shot : record.plan.shots) candidates.insert(shot.candidate);
  EXPECT_EQ(candidates.size(), record.plan.shots.size()) << "a light was taken twice";
  EXPECT_EQ(record.plan.shots.back().candidate, before.plan.shots.back().candidate);
  EXPECT_TRUE(record.plan.shots.back().held_out);
  for (const JournalEvent& captured : record.events) {
    if (captured.event != "shot") continue;
    const auto index = captured.fields["index"].get<std::size_t>();
    EXPECT_EQ(captured.fields["candidate"], record.plan.shots[index].candidate);
  }
}

TEST_F(Replanning, ASessionThatIsCutDecidesAsOneThatIsNot) {
  const Rig rig = blocked_rig(scratch_.path(), true);
  const SessionFolder whole = session(rig, "whole");
  ASSERT_EQ(capture_blocked(whole, rig).outcome, SessionOutcome::done);
  const std::string expected = comparable_text(whole), decided = replans_text(whole);
  ASSERT_FALSE(decided.empty());
  const std::string journal = read_file(whole.journal()).value();
  int line = 0;
  for (std::size_t at = journal.find('\n'); at != std::string::npos;
       at = journal.find('\n', at + 1)) {
    if (++line % 3 != 0) continue;
    const SessionFolder folder{rig.session_root / fmt::format("cut{}", at)};
    fs::copy(whole.root, folder.root, fs::copy_options::recursive);
    fs::resize_file(folder.journal(), at + 1);
    const SessionEnd end = capture_blocked(folder, rig);
    ASSERT_EQ(end.outcome, SessionOutcome::done) << "cut at " << at << ": " << end.reason;
    EXPECT_TRUE(comparable_text(folder) == expected) << "cut at " << at;
    EXPECT_EQ(replans_text(folder), decided) << "cut at " << at;
    fs::remove_all(folder.root);
  }
}

TEST_F(Replanning, APlanThatLosesNothingStandsAsItWasReviewed) {
  const Rig rig = small_rig(scratch_.path(), {five_lights});
  const SessionFolder folder = session(rig, "s");
  ASSERT_EQ(capture_blocked(folder, rig).outcome, SessionOutcome::done);
  EXPECT_TRUE(replans_of(folder).empty()) << replans_text(folder);
}

/// What a light gave when all its planned bins but these gave a good row.
LightYield yield_without(const Prepared& prepared, int shot, double share, bool saturated) {
  const auto candidate = prepared.plan.shots[static_cast<std::size_t>(shot)].candidate;
  const auto cells = prepared.bins.of(candidate);
  BrdfObservations observed;
  for (std::size_t i = 0; i < cells.size(); ++i) {
    const bool lost = static_cast<double>(i) < share * static_cast<double>(cells.size());
    if (lost && !saturated) continue;
    BrdfObservation row;
    row.cell = cells[i];
    row.kind = lost ? BrdfObservation::Kind::above : BrdfObservation::Kind::value;
    row.f = 0.1;
    row.variance = 1e-8;
    observed.rows.push_back(row);
  }
  return yield_of(prepared, shot, observed, 1);
}

/// The plan with all but the first of its five lights where they are worth least, so that others
/// are better whatever is lost.
Prepared poorly_planned() {
  Prepared prepared = five_light_plan();
  std::vector<int> order(prepared.candidates.size());
  std::iota(order.begin(), order.end(), 0);
  std::ranges::stable_sort(order, {}, [&](int i) { return prepared.bins.of(i).size(); });
  std::erase_if(order, [&](int i) {
    return prepared.bins.of(i).empty() ||
           std::ranges::any_of(prepared.plan.shots,
                               [&](const Shot& shot) { return shot.candidate == i; });
  });
  for (std::size_t s = 1; s < 5; ++s) {
    prepared.plan.shots[s].candidate = order[s];
    prepared.plan.shots[s].light = prepared.candidates[static_cast<std::size_t>(order[s])].light;
  }
  return prepared;
}

/// As planned, but of all candidates that may be taken one alone shows anything: the bins of the
/// first light and 30 more. It stands within 15° of the first light, or more than 40° away.
struct OneOther {
  explicit OneOther(bool nearby) : prepared(poorly_planned()) {
    const CandidateBins bins = prepared.bins;
    const std::vector<Shot>& shots = prepared.plan.shots;
    const Eigen::Vector3d middle = prepared.points.position.rowwise().mean();
    for (int i = 0; i < bins.candidates() && other < 0; ++i) {
      const LightPosition& light = prepared.candidates[static_cast<std::size_t>(i)].light;
      const double from_first = angle_between(shots[0].light, light, middle);
      const bool taken =
          std::ranges::any_of(shots, [&](const Shot& s) { return s.candidate == i; });
      const bool tests = angle_between(shots.back().light, light, middle) < held_out_distance;
      if (!taken && !tests && from_first > 0.7) other = i;
    }
    if (nearby && other >= 0) {
      LightPosition& moved = prepared.candidates[static_cast<std::size_t>(other)].light;
      for (const double turn : {-0.2, 0.2}) {
        const LightPosition at{
            false, Eigen::AngleAxisd(turn, Eigen::Vector3d::UnitZ()) * shots[0].light.p};
        if (angle_between(shots.back().light, at, middle) > held_out_distance) moved = at;
      }
      EXPECT_LT(angle_between(shots[0].light, moved, middle), 0.25);
    }
    const auto first = bins.of(shots[0].candidate);
    std::set<std::int32_t> shown(first.begin(), first.end());
    for (std::int32_t cell = 0; shown.size() < first.size() + more; ++cell) {
      if (prepared.plan_basis.valid[static_cast<std::size_t>(cell)] != 0) shown.insert(cell);
    }
    prepared.bins = {.grid = bins.grid, .offset = {0}, .cell = {}};
    for (int i = 0; i < bins.candidates(); ++i) {
      std::vector<std::int32_t> cells;
      if (i == shots[0].candidate) cells.assign(first.begin(), first.end());
      if (i == shots[1].candidate) cells = {*shown.begin()};
      if (i == other) cells.assign(shown.begin(), shown.end());
      prepared.bins.cell.insert(prepared.bins.cell.end(), cells.begin(), cells.end());
      prepared.bins.offset.push_back(static_cast<std::int64_t>(prepared.bins.cell.size()));
    }
  }
  static constexpr int more = 30;
  Prepared prepared;
  int other = -1;
};

TEST(Replan, CountsNoMoreOnBinsThatWereTooBrightNorOnBlockedOnesFromNearby) {
  const Scratch scratch;
  const SessionSpec spec = spec_of(small_rig(scratch.path(), {five_lights}));
  for (const bool nearby : {false, true}) {
    const OneOther scene(nearby);
    ASSERT_GE(scene.other, 0);
    for (const bool saturated : {false, true}) {
      const LightYield lost = yield_without(scene.prepared, 0, 0.7, saturated);
      EXPECT_TRUE(lost_rows(lost));
      EXPECT_EQ(saturated ? lost.saturated : lost.missing, lost.lost());
      const auto found = replan(scene.prepared, spec, {&lost, 1}, {1, {}, {1}}, 1);
      ASSERT_TRUE(found) << nearby << saturated;
      ASSERT_EQ(found->lights.size(), 1U);
      const SelectedLight& light = found->lights[0].second;
      EXPECT_EQ(light.candidate, scene.other);
      EXPECT_LT(found->percent, found->planned_percent);
      // Too bright once is too bright from anywhere; blocked is blocked from beside it.
      const bool again = !saturated && !nearby;
      EXPECT_EQ(light.new_cells, OneOther::more + (again ? lost.lost() : 0)) << nearby << saturated;
    }
  }
}

// Lights close together show different bins (another θd), so that those of a neighbour were not
// among the lost ones. A ball before a light took the light 6° beside it, too, which had been
// chosen for them.
TEST(Replan, TakesNoLightBesideOneThatWasHiddenAltogether) {
  const Scratch scratch;
  const SessionSpec spec = spec_of(small_rig(scratch.path(), {five_lights}));
  for (const bool nearby : {false, true}) {
    const OneOther scene(nearby);
    const LightYield lost = yield_without(scene.prepared, 0, 1, false);
    const auto found = replan(scene.prepared, spec, {&lost, 1}, {1, {}, {1}}, 1);
    EXPECT_EQ(found.has_value(), !nearby);
  }
}

TEST(Replan, LeavesWhatTestsTheResultAndLightsThatLostNothing) {
  const Scratch scratch;
  const SessionSpec spec = spec_of(small_rig(scratch.path(), {five_lights}));
  const Prepared prepared = poorly_planned();
  const Eigen::Vector3d middle = prepared.points.position.rowwise().mean();
  for (const bool saturated : {false, true}) {
    const std::vector<LightYield> yields{yield_without(prepared, 0, 0.9, saturated)};
    const auto found = replan(prepared, spec, yields, {1, {}, {1, 2, 3, 4}}, 1);
    ASSERT_TRUE(found);
    for (const auto& [index, light] : found->lights) {
      const LightPosition& position =
          prepared.candidates[static_cast<std::size_t>(light.candidate)].light;
      EXPECT_NE(light.candidate, prepared.plan.shots[0].candidate);
      EXPECT_GE(angle_between(position, prepared.plan.shots.back().light, middle),
                held_out_distance);
    }
  }
  // Nothing lost, or nothing left to change: the plan stands.
  const std::vector<LightYield> whole{yield_without(prepared, 0, 0, false)};
  EXPECT_FALSE(lost_rows(whole[0]));
  EXPECT_FALSE(replan(prepared, spec, whole, {1, {}, {1, 2, 3, 4}}, 1));
  const std::vector<LightYield> lost{yield_without(prepared, 0, 1, false)};
  EXPECT_FALSE(replan(prepared, spec, lost, {1, {1, 2, 3, 4}, {}}, 1));
}

/// Cells that the first light's yield and these lights show, where what took all of the first one
/// takes all of every light that stands near it.
std::vector<Eigen::Index> cells_seen(const Prepared& prepared, const LightYield& lost,
                                     const std::vector<int>& candidates) {
  constexpr double near = 0.2617;  // 15°
  const Eigen::Vector3d middle = prepared.points.position.rowwise().mean();
  const auto light = [&](int candidate) {
    return prepared.candidates[static_cast<std::size_t>(candidate)].light;
  };
  const int first = prepared.plan.shots[static_cast<std::size_t>(lost.shot)].candidate;
  std::set<Eigen::Index> cells;
  for (std::size_t c = 0; c < lost.had.size(); ++c) {
    if (lost.had[c] != 0) cells.insert(static_cast<Eigen::Index>(c));
  }
  for (const int candidate : candidates) {
    const bool blocked = angle_between(light(first), light(candidate), middle) <= near;
    if (blocked) continue;
    for (const std::int32_t cell : prepared.bins.of(candidate)) cells.insert(cell);
  }
  return {cells.begin(), cells.end()};
}

/// Mean square of what MAP gets wrong of coefficients drawn from the prior.
double mean_square_error(const BrdfBasis& basis, const std::vector<Eigen::Index>& cells) {
  const double sigma = basis.model_sigma;
  const Eigen::MatrixXd G = basis.V(cells, Eigen::all);
  const MapSolver solver(G, Eigen::VectorXd::Constant(G.rows(), sigma * sigma), basis.stddev);
  std::mt19937_64 random(5);
  std::normal_distribution<double> normal;
  double sum = 0;
  constexpr int draws = 400;
  for (int i = 0; i < draws; ++i) {
    const Eigen::VectorXd c = basis.stddev.unaryExpr([&](double s) { return s * normal(random); });
    const Eigen::VectorXd y =
        (G * c).unaryExpr([&](double f) { return f + sigma * normal(random); });
    sum += (solver.solve(y) - c).squaredNorm() / draws;
  }
  return sum;
}

TEST(Replan, TakesLightsThatErrLessOverMaterialsOfThePrior) {
  const Prepared& prepared = five_light_plan();
  const Scratch scratch;
  const SessionSpec spec = spec_of(small_rig(scratch.path(), {five_lights}));
  int changed = 0;
  for (int lost = 0; lost < 5; ++lost) {
    const std::vector<LightYield> yields{yield_without(prepared, lost, 1, false)};
    std::vector<int> open{0, 1, 2, 3, 4};
    std::erase(open, lost);
    const auto found = replan(prepared, spec, yields, {1, {}, open}, 1);
    if (!found) continue;
    ++changed;
    std::vector<int> planned, replanned;
    for (const auto& [index, light] : found->lights) {
      planned.push_back(prepared.plan.shots[static_cast<std::size_t>(index)].candidate);
      replanned.push_back(light.candidate);
    }
    const auto error = [&](const std::vector<int>& lights) {
      return mean_square_error(prepared.plan_basis, cells_seen(prepared, yields[0], lights));
    };
    EXPECT_LT(error(replanned), error(planned)) << "light " << lost << " lost";
  }
  EXPECT_GT(changed, 0);
}

TEST(Replan, WhatTheJournalSaysOfItIsReadBack) {
  const Prepared& prepared = five_light_plan();
  Plan plan = prepared.plan;
  std::swap(plan.shots[1], plan.shots[2]);
  plan.visit_order = {5, 4, 3, 2, 1, 0};
  Plan read = prepared.plan;
  ASSERT_TRUE(apply_replanned(replanned_json(plan, {1, 2}), read));
  EXPECT_EQ(read.visit_order, plan.visit_order);
  EXPECT_EQ(read.shots[1].candidate, plan.shots[1].candidate);
  EXPECT_EQ(read.shots[2].light.p, plan.shots[2].light.p);
  auto wrong = replanned_json(plan, {1});
  wrong["lights"][0]["index"] = 9;
  const auto refused = apply_replanned(wrong, read);
  ASSERT_FALSE(refused);
  EXPECT_THAT(refused.error().message, HasSubstr("lights[0].index is not one of 6 lights"));
}

}  // namespace
}  // namespace lightrig
