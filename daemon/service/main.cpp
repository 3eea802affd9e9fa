// lightrigd: one service, one rig.
#include <fmt/format.h>
#include <systemd/sd-daemon.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <cerrno>
#include <cmath>
#include <csignal>
#include <cstdio>
#include <ctime>
#include <limits>
#include <string>
#include <vector>

#include "config/read_rig.h"
#include "daemon/service/host.h"
#include "drivers/make_safe.h"

namespace {

using namespace lightrig;

struct Options {
  std::string rig, socket = "/run/lightrig/control.sock", session_root, clock_rate, listen,
                   token_file, log_level = "info";
  std::vector<std::string> hosts;
  bool simulate = false, auto_arm = false, allow_remote = false, make_safe = false;
};

int complain(const std::string& message) {
  std::fprintf(stderr, "lightrigd: %s\n", message.c_str());
  return 1;
}

// Hands a signal on to the main thread, whose id is the process'.
extern "C" void hand_to_main_thread(int signal) { tgkill(getpid(), getpid(), signal); }

// Signals wait until this thread asks for them; every thread made later inherits that. Libraries
// have made threads before main() began, which inherit nothing: what the system delivers to one of
// those would end the process on the spot, lamp and all.
sigset_t hold_signals() {
  sigset_t signals;
  sigemptyset(&signals);
  for (int one : {SIGTERM, SIGINT, SIGHUP}) {
    sigaddset(&signals, one);
    std::signal(one, &hand_to_main_thread);
  }
  pthread_sigmask(SIG_BLOCK, &signals, nullptr);
  std::signal(SIGPIPE, SIG_IGN);
  return signals;
}

// Serves until a signal asks for the end; about once a second looks after the house.
int wait_for_end(Host& host, const sigset_t& signals, const Log& log) {
  const timespec second{1, 0};
  while (true) {
    const int signal = sigtimedwait(&signals, nullptr, &second);
    if (signal > 0) {
      log.info("stopping", {{"signal", std::to_string(signal)}});
      return signal;
    }
    host.tick();
    if (host.alive()) {
      const std::string state(name_of(host.service().snapshot().state));
      sd_notify(0, ("WATCHDOG=1\nSTATUS=" + state).c_str());
    } else {
      log.error("session_thread_silent", {{"remedy", "the watchdog will restart the service"}});
    }
  }
}

Result<Rig> rig_of(const Options& options) {
  auto read = read_rig(options.rig);
  for (const Diagnostic& one : read.diagnostics)
    std::fprintf(stderr, "%s\n", to_text(one, read.text).c_str());
  if (!read.value)
    return fail(ErrorCode::invalid_input,
                fmt::format("{} is not a valid rig file; mend what is said above", options.rig));
  Rig rig = std::move(*read.value);
  if (!options.session_root.empty())
    rig.session_root = std::filesystem::absolute(options.session_root);
  if (options.simulate && !rig.simulation)
    return fail(ErrorCode::invalid_input,
                fmt::format("{} has no [simulation] table, so there is nothing to simulate it by",
                            options.rig));
  return rig;
}

Result<HostSettings> settings_of(const Options& options) {
  // A real device moves only when a person on the spot has said so.
  if (options.auto_arm && !options.simulate)
    return fail(ErrorCode::refused,
                "--auto-arm needs --simulate: a rig with real devices is armed by a person");
  auto rig = rig_of(options);
  if (!rig) return tl::unexpected(rig.error());
  HostSettings settings;
  settings.service.rig = std::move(*rig);
  settings.service.simulate = options.simulate;
  if (options.simulate) settings.service.clock_rate = settings.service.rig.simulation->clock_rate;
  if (!options.clock_rate.empty()) {
    char* end = nullptr;
    const double rate = std::strtod(options.clock_rate.c_str(), &end);
    if (!options.simulate || *end != '\0' || !(rate >= 1))
      return fail(ErrorCode::invalid_input,
                  "--clock-rate takes a number from 1, or inf, and needs --simulate");
    settings.service.clock_rate = rate;
  }
  settings.socket = std::filesystem::absolute(options.socket);
  settings.token_file = options.token_file;
  settings.hosts = options.hosts;
  if (!options.listen.empty()) {
    auto address = parse_tcp_address(options.listen);
    if (!address) return tl::unexpected(address.error());
    if (!address->loopback && !options.allow_remote)
      return fail(
          ErrorCode::refused,
          fmt::format("{} can be reached from other machines, and the API is not encrypted; "
                      "use 127.0.0.1 and an SSH tunnel, or say --allow-remote",
                      options.listen));
    settings.listen = *address;
  }
  return settings;
}

// Opening a rig makes its lamp dark and closing it stops its motion: after a crash nothing more is
// needed, and nothing is armed by it.
int make_safe(const Options& options) {
  const auto rig = rig_of(options);
  if (!rig) return complain(rig.error().message);
  if (options.simulate) return 0;
  RealClock clock;
  const auto safe = make_safe(*rig, clock);
  return safe ? 0 : complain(safe.error().message);
}

int serve(const Options& options) {
  const sigset_t signals = hold_signals();
  const auto level = log_level_of(options.log_level);
  Log log(*level, Log::default_sink());
  auto settings = settings_of(options);
  if (!settings) return complain(settings.error().message);
  auto host = Host::start(std::move(*settings), log);
  if (!host) return complain(host.error().message);
  log.info("ready", {{"rig", (*host)->service().rig().name},
                     {"simulated", options.simulate ? "true" : "false"},
                     {"sessions", (*host)->service().rig().session_root.string()},
                     {"pid", std::to_string(getpid())}});
  if (options.auto_arm) (void)(*host)->service().arm({"--auto-arm", "the command line"});
  sd_notify(0, "READY=1");
  wait_for_end(**host, signals, log);
  sd_notify(0, "STOPPING=1");
  const bool was_moving = is_armed((*host)->service().snapshot().state);
  (*host)->service().shut_down();
  const bool dark = !(*host)->service().snapshot().lamp_may_be_on;
  host->reset();
  log.info("stopped", {{"armed_before", was_moving ? "true" : "false"},
                       {"lamp", dark ? "dark" : "MAY BE ON"}});
  return 0;
}

}  // namespace

int main(int argc, char** argv) {
  Options options;
  CLI::App app{
      "The service of one lightrig: it alone moves the gantry, switches the lamp and "
      "takes frames. It starts unarmed.",
      "lightrigd"};
  app.add_option("--rig", options.rig, "Rig file that describes the devices")->required();
  app.add_flag("--simulate", options.simulate,
               "Open the whole rig in memory; no device is touched");
  app.add_option("--clock-rate", options.clock_rate,
                 "With --simulate: how many times faster than real time (inf jumps)");
  app.add_option("--socket", options.socket, "Unix socket of the control API")
      ->envname("LIGHTRIG_SOCKET")
      ->capture_default_str();
  app.add_flag("--auto-arm", options.auto_arm, "Arm at once; refused unless --simulate");
  app.add_option("--session-root", options.session_root,
                 "Where sessions are stored, instead of the rig file's session_root");
  app.add_option("--listen", options.listen,
                 "Also serve API and panel on TCP, e.g. 127.0.0.1:8080");
  app.add_option("--token-file", options.token_file,
                 "Token demanded over TCP; made, mode 0600, where there is none");
  app.add_option("--host", options.hosts,
                 "With --listen: a further name or address that clients know this machine by, "
                 "without a port; may be repeated");
  app.add_flag("--allow-remote", options.allow_remote,
               "Let --listen take an address that other machines can reach");
  app.add_option("--log-level", options.log_level, "debug, info, warning or error")
      ->check(CLI::IsMember({"debug", "info", "warning", "error"}))
      ->capture_default_str();
  app.add_flag("--make-safe", options.make_safe,
               "Only make the lamp dark and stop the motion, then end");
  app.set_version_flag("--version", LIGHTRIG_VERSION);
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    if (error.get_exit_code() == 0) return app.exit(error);  // help or version, as asked
    std::fprintf(stderr, "lightrigd: %s; lightrigd --help shows what it takes\n", error.what());
    return 2;
  }
  return options.make_safe ? make_safe(options) : serve(options);
}
