#include "daemon/session/session.h"

#include "daemon/session/capture_run.h"

namespace lightrig {
namespace {

/// The end of a capture that could not begin: nothing moved, but what the lamp does is made sure
/// of.
SessionEnd not_begun(Devices& devices, Clock& clock, const Error& error) {
  SessionEnd end{SessionOutcome::faulted, error.message, false, error.code == ErrorCode::no_space};
  if (!devices.lamp) return end;
  const auto dark = devices.lamp->set(0, {clock.now() + std::chrono::seconds(2), {}});
  if (!dark) {
    end.lamp_may_be_on = true;
    end.reason += "; LAMP MAY BE ON (" + dark.error().message + "): switch it off at its supply";
  }
  return end;
}

}  // namespace

SessionEnd capture(const SessionFolder& folder, const Rig& rig, const SessionSpec& spec,
                   Prepared& prepared, Devices& devices, Clock& clock, SessionControl& control,
                   const SessionListeners& listeners, const ReopenDevices& reopen) {
  auto journal = Journal::open(folder.journal());
  if (!journal) return not_begun(devices, clock, journal.error());
  auto captured = captured_of(journal->replayed());
  if (!captured) return not_begun(devices, clock, captured.error());
  if (captured->sealed) {
    return not_begun(devices, clock,
                     {ErrorCode::refused,
                      "the session is sealed: retake a shot to open it again, "
                      "or begin a new one"});
  }
  const CaptureTools tools{folder, rig, spec, prepared, devices, clock, control, listeners, reopen};
  CaptureRun run(tools, std::move(*journal), std::move(*captured));
  SessionEnd end = run.run();
  if (listeners.ended) listeners.ended(end);
  return end;
}

}  // namespace lightrig
