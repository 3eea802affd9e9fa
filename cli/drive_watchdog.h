#pragma once

#include "cli/rig_under_test.h"

namespace lightrig::cli {

/// Proves the drives' own dead man, which ends a move when nobody speaks to them any more: the
/// service is held (HeldProcess) amid a move with the lamp lit, and the alarm that the drives then
/// raise is the proof. Without a person it is done only where `unasked`: while the service is held
/// nothing of it protects anybody.
Finding drive_watchdog(const RigUnderTest& rig, bool unasked);

}  // namespace lightrig::cli
