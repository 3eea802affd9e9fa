#include "sim/faults.h"

#include <gtest/gtest.h>

#include <functional>

#include "tests/sim/lab_rig.h"

namespace lightrig::sim {
namespace {

/// A laboratory whose devices obey a script.
struct FaultyLab : Lab {
  explicit FaultyLab(std::vector<Fault> faults)
      : Lab(lab_rig()), script(std::make_shared<FaultScript>(std::move(faults))) {
    devices = with_faults(std::move(devices), script, *clock);
  }
  std::shared_ptr<FaultScript> script;
};

TEST(Faults, WithoutAScriptNothingChangesAndEveryCallIsCounted) {
  FaultyLab lab({});
  EXPECT_TRUE(lab.devices.gantry->home(lab.within(60)));
  EXPECT_TRUE(lab.devices.gantry->move_to(dome_position(0.5, 0.5), lab.within(60)));
  EXPECT_TRUE(lab.devices.lamp->set(0.5, lab.within(1)));
  EXPECT_TRUE(lab.devices.camera->expose(0.1, lab.within(1)));
  EXPECT_EQ(lab.script->calls(DeviceCall::any), 4U);
  EXPECT_EQ(lab.script->calls(DeviceCall::gantry_move), 1U);
  EXPECT_EQ(lab.script->calls(DeviceCall::lamp_state), 0U);
  EXPECT_TRUE(lab.script->struck().empty());
}

TEST(Faults, AnyNthCallOfAnyKindFailsOnceAndTheNextGoesWell) {
  using Call = std::function<std::optional<ErrorCode>(FaultyLab&)>;
  const auto code = [](const auto& result) -> std::optional<ErrorCode> {
    if (result) return std::nullopt;
    return result.error().code;
  };
  const std::vector<std::pair<DeviceCall, Call>> calls = {
      {DeviceCall::gantry_home,
       [&](FaultyLab& l) { return code(l.devices.gantry->home(l.within(60))); }},
      {DeviceCall::gantry_move,
       [&](FaultyLab& l) {
         return code(l.devices.gantry->move_to(dome_position(0.2, 0.2), l.within(60)));
       }},
      {DeviceCall::gantry_status,
       [&](FaultyLab& l) { return code(l.devices.gantry->status(l.within(1))); }},
      {DeviceCall::gantry_clear_fault,
       [&](FaultyLab& l) { return code(l.devices.gantry->clear_fault(l.within(1))); }},
      {DeviceCall::lamp_set,
       [&](FaultyLab& l) { return code(l.devices.lamp->set(0.1, l.within(1))); }},
      {DeviceCall::lamp_state,
       [&](FaultyLab& l) { return code(l.devices.lamp->state(l.within(1))); }},
      {DeviceCall::camera_expose,
       [&](FaultyLab& l) { return code(l.devices.camera->expose(0.1, l.within(1))); }},
  };
  for (const auto& [kind, call] : calls) {
    FaultyLab lab({{kind, 2, FaultEffect::timed_out}, {kind, 3, FaultEffect::refused}});
    ASSERT_TRUE(lab.devices.gantry->home(lab.within(60)));
    if (kind != DeviceCall::gantry_home) {
      EXPECT_EQ(call(lab), std::nullopt);
    }
    const TimePoint before = lab.clock->now();
    EXPECT_EQ(call(lab), ErrorCode::timed_out) << name_of(kind);
    EXPECT_GE(lab.clock->now() - before, std::chrono::seconds(1));  // the deadline passed
    EXPECT_EQ(call(lab), ErrorCode::refused) << name_of(kind);
    EXPECT_EQ(call(lab), std::nullopt) << name_of(kind);
    EXPECT_EQ(lab.script->struck().size(), 2U);
  }
}

TEST(Faults, ADisconnectedDeviceStaysGoneUntilItIsOpenedAgain) {
  FaultyLab lab({{DeviceCall::lamp_set, 1, FaultEffect::disconnected}});
  EXPECT_EQ(lab.devices.lamp->set(0.5, lab.within(1)).error().code, ErrorCode::disconnected);
  EXPECT_EQ(lab.devices.lamp->state(lab.within(1)).error().code, ErrorCode::disconnected);
  EXPECT_EQ(lab.devices.lamp->set(0, lab.within(1)).error().code, ErrorCode::disconnected);
  EXPECT_TRUE(lab.devices.gantry->home(lab.within(60)));
  Devices reopened;
  reopened.camera = make_camera(lab.world);
  reopened.gantry = make_gantry(lab.world);
  reopened.lamp = make_lamp(lab.world);
  lab.devices = with_faults(std::move(reopened), lab.script, *lab.clock);
  EXPECT_TRUE(lab.devices.lamp->set(0.5, lab.within(1)));
}

TEST(Faults, ALostAnswerIsATimeoutAfterTheDeedIsDone) {
  FaultyLab lab({{DeviceCall::gantry_move, 1, FaultEffect::answer_lost}});
  ASSERT_TRUE(lab.devices.gantry->home(lab.within(60)));
  const auto result = lab.devices.gantry->move_to(dome_position(0.7, 0.6), lab.within(60));
  EXPECT_EQ(result.error().code, ErrorCode::timed_out);
  EXPECT_EQ(lab.world->gantry_status().position.axes, dome_position(0.7, 0.6).axes);
}

TEST(Faults, SuccessesThatAreNoneCanBeSeenByWhoeverLooks) {
  FaultyLab lab({{DeviceCall::gantry_move, 1, FaultEffect::short_move},
                 {DeviceCall::gantry_move, 2, FaultEffect::ignored},
                 {DeviceCall::lamp_set, 1, FaultEffect::ignored},
                 {DeviceCall::camera_expose, 2, FaultEffect::wrong_exposure},
                 {DeviceCall::camera_expose, 3, FaultEffect::stale_frame},
                 {DeviceCall::camera_expose, 4, FaultEffect::wrong_size}});
  ASSERT_TRUE(lab.devices.gantry->home(lab.within(60)));
  ASSERT_TRUE(lab.devices.gantry->move_to(dome_position(1.1, 0.2), lab.within(60)));
  EXPECT_NEAR(lab.devices.gantry->status(lab.within(1))->position.axes[0], 1.0, 1e-9);
  ASSERT_TRUE(lab.devices.gantry->move_to(dome_position(0.4, 0.2), lab.within(60)));
  EXPECT_NEAR(lab.devices.gantry->status(lab.within(1))->position.axes[0], 1.0, 1e-9);
  ASSERT_TRUE(lab.devices.lamp->set(0.5, lab.within(1)));
  EXPECT_EQ(lab.devices.lamp->state(lab.within(1))->power, 0);
  const Frame good = *lab.devices.camera->expose(0.1, lab.within(1));
  EXPECT_EQ(lab.devices.camera->expose(0.1, lab.within(1))->exposure, 0.2);
  EXPECT_EQ(lab.devices.camera->expose(0.1, lab.within(1))->id, good.id);
  const Frame half = *lab.devices.camera->expose(0.1, lab.within(1));
  EXPECT_EQ(half.counts.height, 24);
  EXPECT_EQ(half.counts.counts.size(), 24U * 64U);
}

TEST(Faults, TheNthCallOfAllCountsAcrossDevices) {
  FaultyLab lab({{DeviceCall::any, 3, FaultEffect::refused}});
  EXPECT_TRUE(lab.devices.gantry->home(lab.within(60)));
  EXPECT_TRUE(lab.devices.lamp->set(0.1, lab.within(1)));
  EXPECT_EQ(lab.devices.camera->expose(0.1, lab.within(1)).error().code, ErrorCode::refused);
  EXPECT_TRUE(lab.devices.camera->expose(0.1, lab.within(1)));
}

}  // namespace
}  // namespace lightrig::sim
