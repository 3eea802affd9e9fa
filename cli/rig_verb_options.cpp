// Verbs about a rig file, and what they take.
#include "cli/verb_list.h"

#include <memory>

namespace lightrig::cli {

void add_rig_verbs(Verbs& verbs) {
  auto check_options = std::make_shared<CheckOptions>();
  CLI::App* verb = with_json(
      verbs.add("check", "Check a rig file, and a session file with it", check_options, &check),
      check_options->json);
  verb->add_option("rig", check_options->rig, "Rig file")->required();
  verb->add_option("session", check_options->session, "Session file");
  verb->add_flag("--print", check_options->print, "Print effective values and their origin");

  auto plan_options = std::make_shared<PlanOptions>();
  verb = with_json(verbs.add("plan", "Choose the lights and their order", plan_options, &plan),
                   plan_options->json);
  verb->add_option("rig", plan_options->rig, "Rig file")->required();
  verb->add_option("session", plan_options->session, "Session file");
  verb->add_option("-o,--output", plan_options->output, "Write plan.json here");
  verb->add_option("--criterion", plan_options->criterion, "condition or a-optimal")
      ->check(CLI::IsMember({"condition", "a-optimal"}));
  verb->add_option("--lights", plan_options->lights, "Choose so many lights")
      ->check(CLI::Range(1, 1000));
  verb->add_option("--stop", plan_options->stop, "literal, plateau or count")
      ->check(CLI::IsMember({"literal", "plateau", "count"}));
  verb->add_option("--svg", plan_options->svg, "Draw the plan here");
  verb->add_flag("--brute-force", plan_options->brute_force,
                 "Compute it without any shortcut, in binning and in choosing");

  auto dry_options = std::make_shared<DryRunOptions>();
  verb = with_json(
      verbs.add("dry-run", "Every step with its time; moves nothing", dry_options, &dry_run),
      dry_options->json);
  verb->add_option("rig", dry_options->rig, "Rig file")->required();
  verb->add_option("session", dry_options->session, "Session file");
  verb->add_option("--plan", dry_options->plan,
                   "Rehearse this plan.json, as start --plan takes it, instead of making one");

  auto device_options = std::make_shared<DevicesOptions>();
  verb = with_json(verbs.add("devices", "What is plugged in, and what keeps it from opening",
                             device_options, &devices),
                   device_options->json);
  verb->add_option("rig", device_options->rig, "Also open this rig's devices, moving nothing");

  auto simulate_options = std::make_shared<SimulateOptions>();
  verb = with_json(verbs.add("simulate", "Host the far end of every wire a rig names, until Ctrl-C",
                             simulate_options, &simulate),
                   simulate_options->json);
  verb->add_option("rig", simulate_options->rig, "Rig file with a [simulation] table")->required();
  verb->add_option("session", simulate_options->session,
                   "Session file: the object that lies there");
  verb->add_option("--fault", simulate_options->faults, "Script of faults, one a line");
  verb->add_option("--truth", simulate_options->truth,
                   "Write the true BRDF here instead of into the session root");
  verb->add_option("--record", simulate_options->record,
                   "At the end write what every exposure really was, a JSON object a line");
  verb->add_flag("--tell-halts", simulate_options->tell_halts,
                 "Say when the moving gantry was told to stop, in seconds of this machine's "
                 "monotonic clock");
  verb->add_option("--seed", simulate_options->seed, "Of the noise, instead of the rig file's");

  auto json = std::make_shared<bool>(false);
  with_json(verbs.add("backends", "What this build contains, and how to get what it lacks",
                      [json] { return backends(*json); }),
            *json);
  auto stability_json = std::make_shared<bool>(false);
  with_json(verbs.add("stability", "Numerical stability on stiff and extreme cases",
                      [stability_json] { return stability(*stability_json); }),
            *stability_json);
}

}  // namespace lightrig::cli
