// Every verb of `lightrig`, its options and what it calls.
#include "cli/command_line.h"

#include <unistd.h>

#include <CLI/CLI.hpp>
#include <cstdio>
#include <cstdlib>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "cli/verbs.h"
#include "config/suggest.h"

namespace lightrig::cli {
namespace {

// More than any machine of a rig has, and few enough for the system to grant them.
constexpr int most_threads = 1024;

std::string user_name() {
  for (const char* name : {"LIGHTRIG_OPERATOR", "USER", "LOGNAME"})
    if (const char* value = std::getenv(name); value != nullptr && *value != '\0') return value;
  return "uid " + std::to_string(getuid());
}

/// The verbs as they are being put together: each adds its options and what to run.
class Verbs {
 public:
  explicit Verbs(CLI::App& app) : app_(app) {}

  template <class Options>
  CLI::App* add(const char* name, const char* summary, std::shared_ptr<Options> options,
                int (*run)(const Options&)) {
    return add(name, summary, [options, run] { return run(*options); });
  }
  CLI::App* add(const char* name, const char* summary, std::function<int()> run) {
    CLI::App* verb = app_.add_subcommand(name, summary);
    verb->callback([this, run = std::move(run)] { chosen_ = run; });
    return verb;
  }
  int run_chosen() const { return chosen_ ? chosen_() : 2; }

 private:
  CLI::App& app_;
  std::function<int()> chosen_;
};

CLI::App* with_json(CLI::App* verb, bool& json) {
  verb->add_flag("--json", json, "Answer in JSON");
  return verb;
}

CLI::App* with_service(CLI::App* verb, ServiceOptions& options) {
  options.as = user_name();
  verb->add_option("--socket", options.socket, "Control socket of the service")
      ->envname("LIGHTRIG_SOCKET")
      ->default_str("/run/lightrig/control.sock");
  options.socket = "/run/lightrig/control.sock";
  verb->add_option("--as", options.as, "Your name, for the lock and the record");
  return with_json(verb, options.json);
}

void add_threads(CLI::App* verb, int& threads) {
  verb->add_option("--threads", threads, "Threads; all where none is given")
      ->check(CLI::Range(1, most_threads));
}

void add_planning(Verbs& verbs) {
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
  verb->add_flag("--brute-force", plan_options->brute_force, "Compute it without any shortcut");

  auto dry_options = std::make_shared<DryRunOptions>();
  verb = with_json(
      verbs.add("dry-run", "Every step with its time; moves nothing", dry_options, &dry_run),
      dry_options->json);
  verb->add_option("rig", dry_options->rig, "Rig file")->required();
  verb->add_option("session", dry_options->session, "Session file");

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

void add_simple_service_verbs(Verbs& verbs) {
  const auto simple = [&](const char* name, const char* summary) {
    auto options = std::make_shared<ServiceOptions>();
    with_service(verbs.add(name, summary, [options, name] { return command(*options, name); }),
                 *options);
  };
  simple("arm", "Open the devices and allow motion");
  simple("disarm", "Give the devices back; nothing can move");
  simple("clear", "Put a fault, an abort or a result aside");
  simple("home", "Home the gantry");

  for (const char* name : {"pause", "resume", "stop", "halt"}) {
    auto options = std::make_shared<ServiceOptions>();
    auto id = std::make_shared<std::string>();
    const char* summary = name[0] == 'p'   ? "Pause after the exposure in progress"
                          : name[0] == 'r' ? "Go on with a session, also after a restart"
                          : name[0] == 'h' ? "End a session at once, lamp dark, to be resumed"
                                           : "End a session after this shot, then reduce";
    CLI::App* verb = with_service(
        verbs.add(name, summary, [options, id, name] { return steer(*options, name, *id); }),
        *options);
    verb->add_option("session", *id, "Session id; the one in hand where none is given");
  }

  const auto reader = [&](const char* name, const char* summary,
                          int (*run)(const ServiceOptions&)) {
    auto options = std::make_shared<ServiceOptions>();
    with_service(verbs.add(name, summary, options, run), *options);
  };
  reader("status", "State of the rig and of the session in hand", &status);
  reader("watch", "Follow the session in hand", &watch);
  reader("sessions", "Sessions of the rig", &sessions);
}

void add_service_verbs(Verbs& verbs) {
  auto start_options = std::make_shared<StartOptions>();
  CLI::App* verb = with_service(
      verbs.add("start", "Start a session on the service's rig", start_options, &start),
      start_options->service);
  verb->add_option("session", start_options->session, "Session file");
  verb->add_option("--plan", start_options->plan, "Follow this plan.json");
  verb->add_flag("--wait", start_options->wait, "Follow it to its end");

  add_simple_service_verbs(verbs);

  auto service = std::make_shared<ServiceOptions>();
  auto reason = std::make_shared<std::string>();
  verb = with_service(verbs.add("abort", "Stop whatever moves, lamp dark. No emergency stop",
                                [service, reason] { return abort(*service, *reason); }),
                      *service);
  verb->add_option("--reason", *reason, "Why, for the record");

  auto jog_options = std::make_shared<JogOptions>();
  verb = with_service(verbs.add("jog", "Move one axis within its travel", jog_options, &jog),
                      jog_options->service);
  verb->add_option("axis", jog_options->axis, "Axis of the rig file")->required();
  verb->add_option("amount", jog_options->amount, "Degrees (rotary) or millimetres (linear)")
      ->required();
  verb->add_flag("--to", jog_options->to, "A position rather than a step");

  auto locker = std::make_shared<ServiceOptions>();
  auto note = std::make_shared<std::string>();
  verb = with_service(verbs.add("lock", "Reserve the rig; ABORT ignores it",
                                [locker, note] { return lock(*locker, *note); }),
                      *locker);
  verb->add_option("--note", *note, "Why, for others to read");

  auto unlocker = std::make_shared<ServiceOptions>();
  auto force = std::make_shared<bool>(false);
  verb = with_service(verbs.add("unlock", "End the reservation",
                                [unlocker, force] { return unlock(*unlocker, *force); }),
                      *unlocker);
  verb->add_flag("--force", *force, "Take it from whoever holds it");

  auto snapper = std::make_shared<SnapOptions>();
  verb = with_service(verbs.add("snap", "Save the last frame as PNG, or take one", snapper, &snap),
                      snapper->service);
  verb->add_option("-o,--output", snapper->output, "File to write")->capture_default_str();
  verb->add_option("--exposure", snapper->exposure, "Take a frame of so many seconds")
      ->check(CLI::PositiveNumber);
  verb->add_flag("--lamp", snapper->lamp, "Light the lamp for it")->needs("--exposure");
  verb->add_flag("--overlay", snapper->overlay,
                 "Draw the object's outline and the planned lights' highlights over it")
      ->needs(verb->add_option("--rig", snapper->rig, "Rig file, for --overlay"));
  verb->add_option("--session", snapper->session, "Session file, for --overlay");

  auto proving = std::make_shared<CommissionOptions>();
  verb = with_service(
      verbs.add("commission", "Prove a rig step by step, and record it", proving, &commission),
      proving->service);
  verb->add_option("-o,--output", proving->output, "Record to write");
  verb->add_flag("--yes", proving->yes, "Ask nobody: prove what needs no eyes");

  auto bundling = std::make_shared<BundleOptions>();
  verb = with_service(
      verbs.add("bundle", "Collect what a post-mortem needs into one file", bundling, &bundle),
      bundling->service);
  verb->add_option("-o,--output", bundling->output, ".tar.gz to write");
  verb->add_option("--session", bundling->session, "Session folder; else the one in hand");

  auto logger = std::make_shared<ServiceOptions>();
  auto level = std::make_shared<std::string>();
  verb = with_service(verbs.add("log", "Set the service's log level",
                                [logger, level] { return log_level(*logger, *level); }),
                      *logger);
  verb->add_option("level", *level, "debug, info, warning or error")
      ->required()
      ->check(CLI::IsMember({"debug", "info", "warning", "error"}));
}

void add_session_verbs(Verbs& verbs) {
  auto reduce_options = std::make_shared<ReduceOptions>();
  CLI::App* verb = with_json(
      verbs.add("reduce", "Frames to BRDF again, from the folder alone", reduce_options, &reduce),
      reduce_options->json);
  verb->add_option("session", reduce_options->session, "Session folder")->required();
  verb->add_option("-o,--output", reduce_options->output, "Write here instead of the folder");
  verb->add_option("--environment", reduce_options->environment,
                   "Light the report's sphere by this latitude-longitude picture (EXR, HDR)");
  add_threads(verb, reduce_options->threads);

  auto verify_options = std::make_shared<ReduceOptions>();
  verb = with_json(verbs.add("verify", "Prove a session folder: checksums, journal, reduction",
                             verify_options, &verify),
                   verify_options->json);
  verb->add_option("session", verify_options->session, "Session folder")->required();
  add_threads(verb, verify_options->threads);

  auto folder = std::make_shared<std::string>();
  auto json = std::make_shared<bool>(false);
  verb = with_json(verbs.add("result", "What a session found, what it cost, what it left out",
                             [folder, json] { return result(*folder, *json); }),
                   *json);
  verb->add_option("session", *folder, "Session folder")->required();

  auto again = std::make_shared<std::string>();
  auto shot = std::make_shared<std::string>();
  auto retaker = std::make_shared<ServiceOptions>();
  verb = with_service(verbs.add("retake", "Open a captured shot again; its frames are kept",
                                [retaker, again, shot] { return retake(*retaker, *again, *shot); }),
                      *retaker);
  verb->add_option("session", *again, "Session folder, or its id at the service")->required();
  verb->add_option("shot", *shot, "Name of the shot, e.g. L03")->required();

  auto compare_options = std::make_shared<CompareOptions>();
  verb =
      with_json(verbs.add("compare", "Errors of BRDF A against BRDF B", compare_options, &compare),
                compare_options->json);
  verb->add_option("a", compare_options->a, "MERL file or session folder")->required();
  verb->add_option("b", compare_options->b, "MERL file or session folder: the truth")->required();
  verb->add_option("--picture", compare_options->picture, "Write a picture of both (PNG)");
  verb->add_option("--floor", compare_options->floor, "Floor of the logarithm [1/sr]")
      ->check(CLI::PositiveNumber)
      ->capture_default_str();

  auto source = std::make_shared<std::string>();
  auto merl = std::make_shared<std::string>();
  verb = verbs.add("export", "A session's BRDF as a full MERL file",
                   [source, merl] { return export_merl(*source, *merl); });
  verb->add_option("session", *source, "Session folder")->required();
  verb->add_option("--merl", *merl, "File to write")->required();
}

void add_target_options(CLI::App& verb, CalibrateOptions& options) {
  verb.add_option("--target", options.kind, "charuco or checkerboard")
      ->check(CLI::IsMember({"charuco", "checkerboard"}))
      ->capture_default_str();
  verb.add_option("--columns", options.columns, "Squares across")->required();
  verb.add_option("--rows", options.rows, "Squares down")->required();
  verb.add_option("--square-mm", options.square_mm, "Edge of a square, measured on the print")
      ->required()
      ->check(CLI::PositiveNumber);
  verb.add_option("--marker-mm", options.marker_mm, "Edge of a marker (ChArUco)");
}

void add_calibrate_verb(Verbs& verbs) {
  auto options = std::make_shared<CalibrateOptions>();
  auto chosen = std::make_shared<int (*)(const CalibrateOptions&)>(nullptr);
  CLI::App* verb = verbs.add("calibrate", "Calibration from images or from a session",
                             [options, chosen] { return (*chosen)(*options); });
  verb->require_subcommand(1);
  CLI::App* camera = with_json(
      verb->add_subcommand("camera", "Lens and pose from pictures of a target"), options->json);
  camera->add_option("images", options->images, "Pictures of the target")->required();
  add_target_options(*camera, *options);
  camera->add_option("-o,--output", options->output, "Calibration file to write")->required();
  camera->callback([chosen] { *chosen = &calibrate_camera; });
  CLI::App* target = verb->add_subcommand("target", "The target as a picture to print");
  add_target_options(*target, *options);
  target->add_option("-o,--output", options->output, "PNG to write")->required();
  target->callback([chosen] { *chosen = &calibrate_target; });
  CLI::App* white =
      with_json(verb->add_subcommand("white", "Absolute scale from a session on a white target"),
                options->json);
  white->add_option("session", options->session, "Session folder")->required();
  white->add_option("--reflectance", options->reflectance, "Of the target: one number, or R G B")
      ->required()
      ->expected(1, 3);
  white->add_option("-o,--output", options->output, "White reference to write")->required();
  white->callback([chosen] { *chosen = &calibrate_white; });
}

void add_material_verbs(Verbs& verbs) {
  auto name = std::make_shared<std::string>();
  auto directory = std::make_shared<std::string>();
  auto output = std::make_shared<std::string>();
  auto json = std::make_shared<bool>(false);
  auto chosen = std::make_shared<std::function<int()>>();
  CLI::App* verb = verbs.add("materials", "The built-in set, and materials of your own",
                             [chosen] { return (*chosen)(); });
  verb->require_subcommand(1);
  CLI::App* list = with_json(verb->add_subcommand("list", "The built-in set"), *json);
  list->callback([chosen, json] { *chosen = [json] { return materials_list(*json); }; });
  CLI::App* info =
      with_json(verb->add_subcommand("info", "One material, built in or a file"), *json);
  info->add_option("name", *name, "Name, or path of a MERL .binary file")->required();
  info->callback(
      [chosen, name, json] { *chosen = [name, json] { return materials_info(*name, *json); }; });
  CLI::App* import =
      verb->add_subcommand("import", "Check a directory of MERL files, store tables");
  import->add_option("directory", *directory, "Directory of .binary files")->required();
  import->add_option("-o,--output", *output, "Directory to write")->required();
  import->callback([chosen, directory, output] {
    *chosen = [directory, output] { return materials_import(*directory, *output);
};
}  // namespace
);
}  // namespace lightrig::cli

std::vector<std::string> names_of(const CLI::App& app) {
  std::vector<std::string> names;
  for (const CLI::App* verb : app.get_subcommands({})) names.push_back(verb->get_name());
  return names;
}

void add_study_verb(Verbs& verbs) {
  auto options = std::make_shared<StudyVerbOptions>();
  auto shards = std::make_shared<std::vector<std::string>>();
  auto merging = std::make_shared<bool>(false);
  CLI::App* verb = verbs.add(
      "study", "Error against lights and run time, over many plans", [options, shards, merging] {
        return *merging ? study_merge(*shards, options->output) : study(*options);
      });
  verb->add_option("--objects", options->objects, "Shapes, mesh files, or names in --meshes");
  verb->add_option("--meshes", options->meshes, "Folder of named meshes");
  verb->add_option("--materials", options->materials, "builtin, or a directory of MERL files")
      ->capture_default_str();
  verb->add_option("--methods", options->methods,
                   "Methods to compare, by name or LIGHTS:POINTS:ESTIMATOR[:k=N][:exposures=N]; "
                   "all named ones where none is given");
  verb->add_option(
      "--criterion", options->criteria,
      "Axis: condition, a-optimal, random (over pixels; the axes' product is studied)");
  verb->add_option("--estimator", options->estimators,
                   "Axis: pseudo-inverse, map, map-stacked, map-ln-offset, map-log-relative");
  verb->add_option("--k", options->component_counts, "Axis: numbers of components");
  verb->add_option("--exposure-counts", options->exposure_counts,
                   "Axis: exposures of a bracket, as --exposures");
  verb->add_option("--rig", options->rig,
                   "Rig file whose motion model predicts capture times; 12 s a light without");
  verb->add_option("--lights", options->lights, "Numbers of lights to report");
  verb->add_option("--splits", options->splits, "Splits into training and test")
      ->capture_default_str();
  verb->add_option("--random-runs", options->random_runs, "Random light sets per split")
      ->capture_default_str();
  verb->add_option("--candidates", options->candidates, "Candidate lights")->capture_default_str();
  verb->add_option("--components", options->components, "Components of the paper's basis")
      ->capture_default_str();
  verb->add_option("--exposures", options->exposures, "Exposures of a bracket; 0: no clipping")
      ->capture_default_str();
  verb->add_option("--noise", options->noise, "Relative noise of a measured row");
  verb->add_option("--floor", options->floor, "Floor of the logarithm [1/sr]")
      ->capture_default_str();
  verb->add_option("--seed", options->seed, "Of splits and random lights")->capture_default_str();
  add_threads(verb, options->threads);
  verb->add_option("--shard", options->shard, "Do the i-th of n parts: i/n");
  verb->add_flag("--table1", options->table1, "The paper's Table 1 beside ours");
  verb->add_option("-o,--output", options->output, "Folder to write");
  CLI::App* merge = verb->add_subcommand("merge", "Bring the folders of shards together");
  merge->add_option("shards", *shards, "Folders of the shards")->required();
  merge->add_option("-o,--output", options->output, "Folder to write")->required();
  merge->callback([merging] { *merging = true; });
}

// CLI11 knows that a word is unknown, not which one was meant.
int usage_error(const CLI::App& app, const CLI::ParseError& error, int argc, char** argv) {
  const std::vector<std::string> names = names_of(app);
  const std::string word = argc > 1 ? argv[1] : "";
  const bool known = std::find(names.begin(), names.end(), word) != names.end();
  if (!known && !word.empty() && word.front() != '-') {
    const std::string hint = did_you_mean(word, names);
    std::fprintf(stderr, "lightrig: there is no verb \"%s\"%s%s; lightrig --help lists them\n",
                 word.c_str(), hint.empty() ? "" : "; ", hint.c_str());
    return 2;
  }
  if (error.get_exit_code() == 0) return app.exit(error);  // help or version, as asked
  // What comes of typing is said as everything else is: who speaks, what is wrong, where to look.
  std::fprintf(stderr, "lightrig: %s; lightrig %s--help shows what it takes\n", error.what(),
               known ? (word + " ").c_str() : "");
  return 2;
}

}  // namespace

int run(int argc, char** argv) {
  CLI::App app{"Plans the few lights that suffice, captures them, reconstructs the BRDF",
               "lightrig"};
  app.set_version_flag("--version", LIGHTRIG_VERSION);
  app.require_subcommand(1);
  app.get_formatter()->column_width(28);
  Verbs verbs(app);
  add_planning(verbs);
  add_service_verbs(verbs);
  add_session_verbs(verbs);
  add_material_verbs(verbs);
  add_calibrate_verb(verbs);
  add_study_verb(verbs);
  std::string shell;
  CLI::App* verb = verbs.add("completion", "Print a completion script for a shell",
                             [&] { return completion(shell, names_of(app)); });
  verb->add_option("shell", shell, "bash, zsh or fish")
      ->required()
      ->check(CLI::IsMember({"bash", "zsh", "fish"}));
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    return usage_error(app, error, argc, argv);
  }
  return verbs.run_chosen();
}

}  // namespace lightrig::cli
