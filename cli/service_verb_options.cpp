// Verbs that ask the service, and what they take.
#include "cli/verb_list.h"

#include <memory>
#include <string>

namespace lightrig::cli {
namespace {

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

}  // namespace

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
  verb->add_flag(
      "--try-watchdog", proving->try_watchdog,
      "With --yes: hold the service, and its ABORT with it, while the arm moves, so that "
      "the drives' own watchdog must stop it");

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

}  // namespace lightrig::cli
