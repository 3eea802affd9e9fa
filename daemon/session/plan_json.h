#pragma once

#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "core/result.h"
#include "daemon/session/prepare.h"

namespace lightrig {

/// plan.json, schema lightrig.plan/1. Numbers round-trip; infinity as null. `cost` stands apart
/// from what is compared.
std::string plan_to_json(const Rig& rig, const SessionSpec& spec, const Prepared& prepared);

/// Reads plan.json back. Errors: invalid_input with the JSON path of what is wrong; `name` is what
/// the message calls the document.
Result<Plan> plan_from_json(const std::string& text, const std::string& name = "plan.json");

/// The fields of a `replanned` event: these lights as the plan has them now, and the way.
nlohmann::ordered_json replanned_json(const Plan& plan, const std::vector<int>& lights);

/// Takes a `replanned` event up into the plan. Errors: invalid_input with the path of what is
/// wrong.
Result<void> apply_replanned(const nlohmann::ordered_json& event, Plan& plan);

/// plan.json's text with the lights and the way as these `replanned` events have left them. Errors:
/// invalid_input.
Result<std::string> with_replanned(const std::string& plan,
                                   const std::vector<nlohmann::ordered_json>& events);

/// Whether a stored plan was made from what was loaded now: the same mesh and the same materials,
/// by their hashes. Errors: invalid_input naming what differs.
Result<void> check_made_for(const Plan& plan, const Prepared& prepared);

}  // namespace lightrig
