#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

namespace lightrig::cli {

// What a person typed after each verb, and what answers it. Every verb returns the exit code:
// 0 done, 1 it failed (the reason is on standard error), 2 usage.

struct CheckOptions {
  std::string rig, session;
  bool print = false, json = false;
};
int check(const CheckOptions& options);

struct PlanOptions {
  std::string rig, session, output, criterion, stop, svg;
  std::optional<int> lights;
  bool brute_force = false, json = false;
};
int plan(const PlanOptions& options);

struct DryRunOptions {
  std::string rig, session, plan;
  bool json = false;
};
int dry_run(const DryRunOptions& options);

struct DevicesOptions {
  std::string rig;
  bool json = false;
};
int devices(const DevicesOptions& options);

/// How to reach the service, and as whom.
struct ServiceOptions {
  std::string socket, as;
  bool json = false;
};

struct StartOptions {
  ServiceOptions service;
  std::string session, plan;
  bool wait = false;
};
int start(const StartOptions& options);
int watch(const ServiceOptions& options);
int status(const ServiceOptions& options);

/// Commands that end by themselves: arm, disarm, clear, home.
int command(const ServiceOptions& options, const std::string& verb);

struct JogOptions {
  ServiceOptions service;
  std::string axis;
  double amount = 0;  ///< [deg] or [mm]
  bool to = false;    ///< an absolute position rather than a step
};
int jog(const JogOptions& options);

/// pause, resume, stop, halt; an empty id means the session in hand. Waits until it is so and says
/// so; 1 where it is not so in time.
int steer(const ServiceOptions& options, const std::string& verb, const std::string& id);
int abort(const ServiceOptions& options, const std::string& reason);
int lock(const ServiceOptions& options, const std::string& note);
int unlock(const ServiceOptions& options, bool force);
int sessions(const ServiceOptions& options);
/// With a rig file the planned object's outline and highlights are drawn over the frame.
struct SnapOptions {
  ServiceOptions service;
  std::string output = "snap.png", rig, session;
  double exposure = 0;  ///< [s] 0: the last frame that was taken
  bool lamp = false, overlay = false;
};
int snap(const SnapOptions& options);
int log_level(const ServiceOptions& options, const std::string& level);

struct CommissionOptions {
  ServiceOptions service;
  std::string output;         ///< of the record; "" for a name with the time, here
  bool yes = false;           ///< ask nobody
  bool try_watchdog = false;  ///< with `yes`: hold the service while the arm moves
};
int commission(const CommissionOptions& options);

struct BundleOptions {
  ServiceOptions service;
  std::string session, output;
};
/// What a post-mortem needs in one .tar.gz, whether or not the service answers.
int bundle(const BundleOptions& options);

struct ReduceOptions {
  std::string session, output, environment;
  int threads = 0;
  bool json = false;
};
int reduce(const ReduceOptions& options);
int verify(const ReduceOptions& options);
int result(const std::string& session, bool json);
/// `session` is a folder here, or an id that the service knows.
int retake(const ServiceOptions& options, const std::string& session, const std::string& shot);

struct CompareOptions {
  std::string a, b, picture;
  double floor = 1e-4;
  bool json = false;
};
int compare(const CompareOptions& options);
int export_merl(const std::string& session, const std::string& output);

int materials_list(bool json);
int materials_info(const std::string& name, bool json);
int materials_import(const std::string& directory, const std::string& output);

int backends(bool json);

struct SimulateOptions {
  std::string rig, session, faults, truth, record;
  std::optional<std::uint64_t> seed;
  bool json = false, tell_halts = false;
};
/// Hosts the far end of every wire the rig names, until SIGTERM or SIGINT.
int simulate(const SimulateOptions& options);

struct CalibrateOptions {
  std::vector<std::string> images;
  std::string session, output, kind = "charuco";
  int columns = 0, rows = 0;
  double square_mm = 0, marker_mm = 0;
  std::vector<double> reflectance;
  std::vector<double> board_origin, board_columns, board_rows;  ///< [m]; empty: not given
  std::string board_image;
  bool json = false;
};
int calibrate_camera(const CalibrateOptions& options);
int calibrate_target(const CalibrateOptions& options);
int calibrate_white(const CalibrateOptions& options);

struct StudyVerbOptions {
  std::vector<std::string> objects{"sphere"}, methods, criteria, estimators;
  std::vector<int> lights, component_counts, exposure_counts;
  std::string meshes, materials = "builtin", output, shard, rig;
  int splits = 10, random_runs = 6, candidates = 1000, components = 45, exposures = 0, threads = 0;
  double noise = 0, floor = 1e-4;
  std::uint64_t seed = 1;
  bool table1 = false, around_median = false;
};
int study(const StudyVerbOptions& options);
/// Brings the folders of shards together.
int study_merge(const std::vector<std::string>& shards, const std::string& output);

/// Stiff and extreme cases against high precision; 1 if one fails.
int stability(bool json);

/// Shell completion script of "bash", "zsh" or "fish", from the verbs and options of this program.
int completion(const std::string& shell, const std::vector<std::string>& verbs);

}  // namespace lightrig::cli
