#pragma once

#include <gtest/gtest.h>

#include <functional>
#include <memory>
#include <ostream>
#include <string>

#include "config/rig.h"
#include "drivers/devices.h"

namespace lightrig {

/// What the contract tests need of a backend: opened devices, the rig they were opened for, the
/// clock they wait on. `keep_alive` holds the far end of the wire; it outlives the devices.
struct ContractSubject {
  std::string absent;  ///< why there is no such backend here; then nothing else is filled in
  Rig rig;
  std::shared_ptr<Clock> clock;
  std::shared_ptr<void> keep_alive;
  Devices devices;
  /// What the far end itself says of the lamp, after the devices are gone; empty if it cannot.
  std::function<double()> lamp_power_at_far_end;
  /// Whether the far end's drives are in motion; empty if it cannot say.
  std::function<bool()> moving_at_far_end;
};

/// A backend under contract. The rig must have: a dome of at least ±90° azimuth and 10° … 60°
/// elevation about its home at speeds that cross it within seconds; max_power ≥ 0.5; exposures from
/// 1 ms to 0.2 s; a lamp lease of at least 10 s.
struct ContractBackend {
  std::string name;  ///< letters and digits
  std::function<ContractSubject()> open;
};

inline void PrintTo(const ContractBackend& backend, std::ostream* out) { *out << backend.name; }

/// One suite for every Gantry, Lamp and Camera, in memory or at the far end of a wire:
///   INSTANTIATE_TEST_SUITE_P(ModbusTcp, DeviceContract,
///                            testing::Values(ContractBackend{"ModbusTcp", open_modbus_tcp}));
/// The tests themselves are in contract_test.cpp, linked into the same program.
class DeviceContract : public testing::TestWithParam<ContractBackend> {
 protected:
  void SetUp() override {
    subject = GetParam().open();
    if (!subject.absent.empty()) GTEST_SKIP() << subject.absent;
    ASSERT_TRUE(subject.clock) << "it was not opened";
  }

  Until within(double seconds, std::stop_token stop = {}) const;
  /// Axis values of the home position plus these shares of the first and second axis' way to its
  /// upper limit.
  GantryPosition beside_home(double first, double second) const;

  ContractSubject subject;
};

/// What the same backends promise while something lasts: not for a clock on which nothing does.
class DeviceContractInTime : public DeviceContract {};

}  // namespace lightrig
