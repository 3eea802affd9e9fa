#include "tests/session/scene.h"

#include <gtest/gtest.h>

#include <limits>
#include <map>

#include "config/read_rig.h"
#include "core/check.h"
#include "daemon/session/durable_file.h"
#include "sim/open_devices.h"
#include "sim/sim_clock.h"
#include "tests/session/scratch.h"

namespace lightrig {
namespace {

namespace fs = std::filesystem;

constexpr const char* rig_text = R"(
[rig]
name = "bench"
session_root = "sessions"

[camera]
backend = "simulated"
width_px = 48
height_px = 36
projection = "perspective"
fx_px = 300
eye_m = [0.0, -0.9, 0.45]
target_m = [0.0, 0.0, 0.0]
readout_ms = 40

[camera.sensor]
filter = "mono"
bits = 12
gain_e_per_dn = 2.6
black_level_dn = 64
read_noise_e = 3.5
dark_current_e_per_s = 2.0
full_well_e = 10600
response_e_m2_sr_per_j = 1.6e5
min_exposure_s = 10e-6
max_exposure_s = 2.0

[gantry]
backend = "simulated"
kinematics = "dome"
radius_m = 0.8
settle_s = 0.8
tolerance_deg = 0.02

[[gantry.axis]]
name = "azimuth"
min_deg = -170
max_deg = 170
max_speed_deg_per_s = 40
max_acceleration_deg_per_s2 = 60
home_deg = 0

[[gantry.axis]]
name = "elevation"
min_deg = 5
max_deg = 88
max_speed_deg_per_s = 25
max_acceleration_deg_per_s2 = 40
home_deg = 10

[lamp]
backend = "simulated"
kind = "near"
strength_w_per_sr = 20
absolute_scale = true
max_power = 1.0
power = 1.0
warm_up_s = 5
max_on_time_s = 30

[interlocks.door]
input = "door"

[candidates]
count = 120

[simulation]
material = "polystyrene-maroon"
seed = 1
clock_rate = 20
arm_frequency_hz = 8
arm_damping = 0.06
ambient_w_per_m2_sr = 0.002

[object]
shape = "sphere"
size_m = 0.1

[materials]
source = "builtin"
leave_out_families = ["plastic", "metal", "metallic-paint", "powder", "retroreflector", "fabric", "stone", "wood"]

[plan]
criterion = "a-optimal"
stop = "count"
max_lights = 3
estimator = "map"
held_out_lights = 1

[bracket]
exposures_s = [80e-6, 1.28e-3, 20.48e-3, 327.68e-3]
target_snr = 50

[session]
sample_id = "bench"
)";

}  // namespace

Rig small_rig(const fs::path& folder, const std::vector<RigChange>& changes) {
  std::string text = rig_text;
  for (const RigChange& change : changes) {
    const std::size_t at = text.find(change.from);
    CHECK(at != std::string::npos);
    text.replace(at, change.from.size(), change.to);
  }
  CHECK(write_durably(folder / "rig.toml", text));
  Read<Rig> rig = read_rig(folder / "rig.toml");
  for (const Diagnostic& diagnostic : rig.diagnostics) {
    if (!rig.value) ADD_FAILURE() << to_text(diagnostic, rig.text);
  }
  CHECK(rig.value);
  return *rig.value;
}

SessionSpec spec_of(const Rig& rig) {
  Read<SessionSpec> spec = read_session({}, rig);
  for (const Diagnostic& diagnostic : spec.diagnostics) {
    if (!spec.value) ADD_FAILURE() << to_text(diagnostic, rig.text);
  }
  CHECK(spec.value);
  return *spec.value;
}

const Prepared& small_plan() {
  static const Prepared prepared = [] {
    const Scratch scratch;
    const Rig rig = small_rig(scratch.path());
    auto made = prepare(rig, spec_of(rig));
    if (!made) ADD_FAILURE() << made.error().message;
    CHECK(made);
    return std::move(*made);
  }();
  return prepared;
}

Laboratory::Laboratory(const Rig& the_rig, std::vector<sim::Fault> faults)
    : rig(the_rig),
      clock(sim::make_clock(std::numeric_limits<double>::infinity())),
      world(sim::make_world(rig, spec_of(rig).object, *clock, rig.simulation->seed).value()),
      script(std::make_shared<sim::FaultScript>(std::move(faults))),
      devices(sim::with_faults(sim::open_devices(rig, world).value(), script, *clock)) {}

ReopenDevices Laboratory::reopen() {
  return
      [this](Reopen what, std::unique_ptr<Camera> old, const std::stop_token&) -> Result<Devices> {
        old.reset();
        auto opened = sim::open_devices(rig, world);
        if (!opened) return opened;
        asked_to_reopen.push_back(what);
        Devices anew = sim::with_faults(std::move(*opened), script, *clock);
        if (what != Reopen::everything) anew.gantry.reset();
        if (what == Reopen::camera) anew.lamp.reset();
        if (what == Reopen::lamp) anew.camera.reset();
        return anew;
      };
}

SessionEnd capture_in(const SessionFolder& folder, Laboratory& laboratory, SessionControl& control,
                      const SessionListeners& listeners) {
  Prepared prepared = small_plan();
  return capture(folder, laboratory.rig, spec_of(laboratory.rig), prepared, laboratory.devices,
                 *laboratory.clock, control, listeners, laboratory.reopen());
}

std::string comparable_text(const SessionFolder& folder) {
  std::string text;
  const Replay replay = replay_journal(folder.journal()).value();
  for (const JournalEvent& event : replay.events) {
    if (event.event != "shot" && event.event != "dark") continue;
    nlohmann::ordered_json fields = event.fields;
    fields.erase("measured");
    text += event.event + " " + fields.dump() + "\n";
  }
  std::map<std::string, std::string> frames;
  for (const auto& entry : fs::recursive_directory_iterator(folder.frames())) {
    if (entry.path().extension() != ".exr") continue;
    frames[entry.path().lexically_relative(folder.root)] =
        sha256_hex(read_file(entry.path()).value());
  }
  for (const auto& [name, hash] : frames) text += name + " " + hash + "\n";
  return text;
}

}  // namespace lightrig
