#pragma once

#include <string>

#include "core/result.h"
#include "daemon/session/prepare.h"

namespace lightrig {

/// plan.json, schema lightrig.plan/1. Numbers round-trip; infinity as null. `cost` stands apart
/// from what is compared.
std::string plan_to_json(const Rig& rig, const SessionSpec& spec, const Prepared& prepared);

/// Reads plan.json back. Errors: invalid_input with the JSON path of what is wrong; `name` is what
/// the message calls the document.
Result<Plan> plan_from_json(const std::string& text, const std::string& name = "plan.json");

/// Whether a stored plan was made from what was loaded now: the same mesh and the same materials,
/// by their hashes. Errors: invalid_input naming what differs.
Result<void> check_made_for(const Plan& plan, const Prepared& prepared);

}  // namespace lightrig
