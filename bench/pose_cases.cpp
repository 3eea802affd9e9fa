// Does the pose check of a session's start flag a pose that is off, and let a right one pass?
// Seeded cases: rigs of the demo's make, built-in shapes, any of the built-in materials, any light
// of the plan; the laboratory's own renderer and sensor, which share no code with the check, and
// the exposures that the session's metering would choose. Every case is judged as it should lie,
// turned by 1° about an axis in a random direction (of a body of revolution: across its axis, since
// about it nothing changes; a sphere is not turned), and shifted by 2 % of its size in a random
// direction. A wrong pose counts as unseen, neither flagged nor missed, where of its motion no more
// lies along those that the verdict does not name as unseen than a right pose is allowed to be off.
// Last a line of key=value figures.
//
//     pose_cases --help
#include <fmt/format.h>
#include <fmt/ranges.h>

#include <CLI/CLI.hpp>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <ctime>
#include <filesystem>
#include <memory>
#include <numbers>
#include <optional>
#include <random>
#include <string>
#include <vector>

#include "config/read_rig.h"
#include "core/builtin_materials.h"
#include "core/merge_hdr.h"
#include "daemon/session/capture_time.h"
#include "daemon/session/lit_sites.h"
#include "daemon/session/pose_check.h"
#include "daemon/session/pose_opinion.h"
#include "daemon/session/session_folder.h"
#include "sim/sensor_noise.h"
#include "sim/shading.h"
#include "sim/truth.h"
#include "tests/paths.h"

namespace {

using namespace lightrig;

constexpr double degree = std::numbers::pi / 180;

struct Options {
  int cases = 100, begin = 0, width = 640, lights = 0, shot = -1, stride = 0;
  unsigned seed = 1;
  std::string shape = "all", mesh, material, session;
  bool first = false, verbose = false, right_only = false;
};

struct Scene {
  Rig rig;
  SessionSpec spec;
  Prepared prepared;
};

/// In the middle of the scene, as large as what it stands for.
void put_mesh(const std::string& file, ObjectConfig& object) {
  object.shape.clear();
  object.mesh = file;
  const auto loaded = load_object(object);
  if (!loaded) {
    fmt::print(stderr, "{}\n", loaded.error().message);
    std::exit(1);
  }
  const Eigen::Vector3d low = loaded->mesh.vertices.rowwise().minCoeff();
  const Eigen::Vector3d high = loaded->mesh.vertices.rowwise().maxCoeff();
  object.unit = object.size / (high - low).maxCoeff();
  object.world_from_object.translation() = -object.unit * (low + high) / 2;
}

Scene scene_of(const std::string& shape, const Options& options) {
  const int width = options.width;
  auto rig = read_rig(std::string(test::source_dir) + "/config/demo.toml");
  Rig r = *rig.value;
  CameraModel& camera = r.camera.model;
  const double scale = static_cast<double>(width) / camera.width;
  camera.width = width;
  camera.height = static_cast<int>(std::lround(camera.height * scale));
  camera.fx *= scale;
  camera.fy *= scale;
  camera.cx = (camera.cx + 0.5) * scale - 0.5;
  camera.cy = (camera.cy + 0.5) * scale - 0.5;
  auto spec = *read_session("", r).value;
  spec.object.shape = shape;
  if (!options.mesh.empty()) put_mesh(options.mesh, spec.object);
  spec.plan.random_baseline = false;
  if (options.lights > 0) spec.plan.max_lights = options.lights;
  spec.plan.pixel_stride = options.stride > 0 ? options.stride : std::max(1, width / 160);
  auto prepared = prepare(r, spec);
  if (!prepared) {
    fmt::print("{}: {}\n", shape, prepared.error().message);
    std::exit(1);
  }
  return {std::move(r), std::move(spec), std::move(*prepared)};
}

Eigen::Vector3d somewhere(std::mt19937_64& random) {
  std::normal_distribution<double> normal(0, 1);
  Eigen::Vector3d v;
  for (Eigen::Index i = 0; i < 3; ++i) v[i] = normal(random);
  return v.normalized();
}

struct Box {
  Eigen::Vector3d middle;
  double size;
};

Box box_of(const Mesh& mesh) {
  const Eigen::Vector3d low = mesh.vertices.rowwise().minCoeff();
  const Eigen::Vector3d high = mesh.vertices.rowwise().maxCoeff();
  return {(low + high) / 2, (high - low).maxCoeff()};
}

Eigen::Isometry3d about(const Eigen::Vector3d& middle, const Eigen::AngleAxisd& turn) {
  return Eigen::Translation3d(middle) * turn * Eigen::Translation3d(-middle);
}

/// The frames a session would take of the object moved.
struct Taken {
  std::vector<Frame> lit, dark;
};

Taken taken(const Scene& scene, int shot, const BuiltinMaterial& material,
            const Eigen::Isometry3d& motion, std::uint64_t seed) {
  Mesh moved = scene.prepared.object.mesh;
  moved.vertices = (motion.linear() * moved.vertices).colwise() + motion.translation();
  moved.normals = motion.linear() * moved.normals;
  const SensorModel& sensor = scene.rig.camera.sensor;
  const CameraModel& camera = scene.rig.camera.model;
  const sim::Renderer renderer(std::move(moved), camera, sensor.filter, material.reflectance,
                               {2, 2, seed});
  const Shot& planned = scene.prepared.plan.shots[static_cast<std::size_t>(shot)];
  const auto radiance = *renderer.render(planned.light, scene.rig.lamp.strength, {});
  std::uint64_t frames = 0;
  const auto expose = [&](const sim::SiteRadiance& sites, double t) {
    const std::uint64_t words[] = {frames};
    return Frame{*sim::expose_sensor(sensor, camera.width, camera.height, sites, t,
                                     sim::derive_key(seed, words), 2, {}),
                 t, ++frames};
  };
  Taken out;
  const std::vector<double>& offered = scene.spec.bracket.exposures;
  const double metering = metering_exposure(offered);
  out.lit.push_back(expose(radiance, metering));
  const ExposureChoice choice =
      choose_exposures(out.lit[0], lit_sites(scene.rig, scene.spec, scene.prepared, shot), offered,
                       sensor, scene.spec.bracket.target_snr);
  for (const double t : choice.exposures)
    if (t != metering) out.lit.push_back(expose(radiance, t));
  out.dark.push_back(expose(sim::SiteRadiance(radiance.size(), 0.0F), offered.back()));
  return out;
}

struct Tally {
  int right = 0, false_flags = 0, turned = 0, missed_turns = 0, shifted = 0, missed_shifts = 0;
  int unseen = 0, untold = 0;
  double seconds = 0;
  int fits = 0;
};

double cpu_seconds() { return static_cast<double>(std::clock()) / CLOCKS_PER_SEC; }

void print_fit(const char* what, const std::string& name, const PoseFit& fit, double seconds) {
  fmt::print(
      "  {:8} {:28} off {:.2f} sure {:.2f} turn {:.2f}° shift {:.2f} mm deviations {:.2f} overlap "
      "{:.4f} unexplained {:.3f} blocks {} {}{:.2f} s\n",
      what, name, fit.off, fit.sure, fit.turn.norm() / degree, 1000 * fit.shift.norm(),
      fmt::join(fit.deviation.data(), fit.deviation.data() + fit.deviation.size(), " "),
      fit.overlap, fit.unexplained, fit.blocks, fit.told ? "" : "UNTOLD ", seconds);
}

PoseFit look(const Scene& scene, int shot, const BuiltinMaterial& material,
             const Eigen::Isometry3d& motion, std::uint64_t seed, const Options& options,
             const char* what, Tally& tally) {
  const Taken frames = taken(scene, shot, material, motion, seed);
  const double begin = cpu_seconds();
  const PoseFit fit = judge_pose(scene.rig, scene.prepared, shot, frames.lit, frames.dark).value();
  const double seconds = cpu_seconds() - begin;
  tally.seconds += seconds;
  ++tally.fits;
  if (options.verbose)
    print_fit(what, fmt::format("shot {} {}", shot, material.name), fit, seconds);
  return fit;
}

/// As a session does: a light that shows too little or leaves a doubt leaves it to the next.
PoseFit verdict(const Scene& scene, std::size_t first, const BuiltinMaterial& material,
                const Eigen::Isometry3d& motion, std::uint64_t seed, const Options& options,
                const char* what, Tally& tally) {
  const std::vector<int>& order = scene.prepared.plan.visit_order;
  std::vector<PoseFit> looks;
  PoseOpinion held;
  for (std::size_t i = 0; i < order.size() && !held.decided; ++i) {
    const int shot = order[(first + i) % order.size()];
    looks.push_back(look(scene, shot, material, motion, seed + i, options, what, tally));
    held = opinion(looks);
  }
  tally.untold += looks[held.by].told ? 0 : 1;
  return looks[held.by];
}

/// Directions about which turning a shape changes nothing are not drawn.
Eigen::Vector3d axis_for(const std::string& shape, std::mt19937_64& random) {
  Eigen::Vector3d axis = somewhere(random);
  if (shape == "cylinder" || shape == "torus") axis.z() = 0;
  return axis.normalized();
}

std::vector<BuiltinMaterial> materials_of(const Options& options) {
  std::vector<BuiltinMaterial> materials;
  for (const BuiltinMaterial& one : builtin_materials())
    if (one.name.find(options.material) != std::string::npos ||
        one.family.find(options.material) != std::string::npos)
      materials.push_back(one);
  if (materials.empty()) {
    fmt::print(stderr, "no built-in material has '{}' in its name or family\n", options.material);
    std::exit(1);
  }
  return materials;
}

/// Every captured shot of a session's folder, judged as if it had been the first.
int judge_session(const std::string& folder) {
  const auto record = read_session_folder(folder);
  const auto prepared = record ? prepare_with_plan(record->rig, record->spec, record->plan)
                               : Result<Prepared>(tl::unexpected(record.error()));
  if (!prepared) {
    fmt::print(stderr, "{}\n", prepared.error().message);
    return 1;
  }
  for (const CapturedShot& shot : record->shots) {
    const double begin = cpu_seconds();
    const auto fit = check_pose(record->rig, *prepared, record->folder, shot);
    if (fit)
      print_fit(shot.name.c_str(), wrong(*fit) ? "wrong" : "as modelled", *fit,
                cpu_seconds() - begin);
    else
      fmt::print("  {}: {}\n", shot.name, fit.error().message);
  }
  return 0;
}

/// Where in the route to begin: with the light that is asked for, as a session does, or anywhere.
std::size_t first_light(const Scene& scene, const Options& options, std::mt19937_64& random) {
  const std::vector<int>& order = scene.prepared.plan.visit_order;
  const std::size_t any = random() % order.size();
  if (options.shot < 0) return options.first ? 0 : any;
  const auto found = std::ranges::find(order, options.shot);
  if (found != order.end()) return static_cast<std::size_t>(found - order.begin());
  fmt::print(stderr, "--shot: the plan has the lights 0 to {}\n", order.size() - 1);
  std::exit(1);
}

Tally run(const std::string& shape, const Options& options) {
  const Scene scene = scene_of(shape, options);
  const Box box = box_of(scene.prepared.object.mesh);
  const auto materials = materials_of(options);
  Tally tally;
  for (int i = options.begin; i < options.begin + options.cases; ++i) {
    std::mt19937_64 random(options.seed * 1000003U + static_cast<unsigned>(i));
    const BuiltinMaterial& material = materials[random() % materials.size()];
    const std::size_t first = first_light(scene, options, random);
    const Eigen::Vector3d axis = axis_for(shape, random), way = somewhere(random);
    const Eigen::Isometry3d right = Eigen::Isometry3d::Identity();
    const Eigen::Isometry3d turn = about(box.middle, Eigen::AngleAxisd(degree, axis));
    Eigen::Isometry3d shift = right;
    shift.translate(0.02 * box.size * way);
    const auto judge = [&](const Eigen::Isometry3d& motion, const char* what) {
      return verdict(scene, first, material, motion, random(), options, what, tally);
    };
    ++tally.right;
    if (wrong(judge(right, "right"))) {
      ++tally.false_flags;
      fmt::print("{} case {}: a right pose is flagged, {}\n", shape, i, material.name);
    }
    std::fflush(stdout);
    if (options.right_only) continue;
    Eigen::Matrix<double, 6, 1> motion = Eigen::Matrix<double, 6, 1>::Zero();
    // Whether it was flagged, missed, or said to be unseen.
    const auto count = [&](const Eigen::Isometry3d& moved, const char* what, int& all,
                           int& missed) {
      const PoseFit fit = judge(moved, what);
      const Eigen::Vector3d seen =
          scene.rig.camera.model.camera_from_world.linear() * (motion.head<3>() + motion.tail<3>());
      const bool unseen = fit.told && fit.seen_of(motion) <= pose_tolerance;
      if (unseen) {
        ++tally.unseen;
      } else {
        ++all;
        missed += wrong(fit) ? 0 : 1;
      }
      if (!unseen && wrong(fit)) return;
      fmt::print("{} case {}: {} {} ({:.2f}, {:.2f}, {:.2f}) as the camera sees it, {}\n", shape, i,
                 unseen ? "said to be unseen:" : "missed", what, seen.x(), seen.y(), seen.z(),
                 material.name);
    };
    motion.head<3>() = axis;
    if (shape != "sphere") count(turn, "turned about", tally.turned, tally.missed_turns);
    motion << Eigen::Vector3d::Zero(), way;
    count(shift, "shifted along", tally.shifted, tally.missed_shifts);
    std::fflush(stdout);
  }
  fmt::print(
      "{:9} {} px: right {} false {}; turned {} missed {}; shifted {} missed {}; unseen {}; "
      "untold {}; looks {} of {:.2f} s each\n",
      shape, options.width, tally.right, tally.false_flags, tally.turned, tally.missed_turns,
      tally.shifted, tally.missed_shifts, tally.unseen, tally.untold, tally.fits,
      tally.seconds / tally.fits);
  std::fflush(stdout);
  return tally;
}

}  // namespace

int main(int argc, char** argv) {
  Options options;
  CLI::App app{"Seeded poses, right and wrong, before the pose check of a session's start"};
  app.add_option("--cases", options.cases, "of each shape: each lies right, is turned, is shifted")
      ->check(CLI::Range(1, 1000000))
      ->capture_default_str();
  app.add_option("--begin", options.begin, "the first case's number")
      ->check(CLI::Range(0, 1000000))
      ->capture_default_str();
  app.add_option("--seed", options.seed)->capture_default_str();
  app.add_option("--shape", options.shape)
      ->check(CLI::IsMember({"teapot", "torus", "cylinder", "sphere", "plane", "all"}))
      ->capture_default_str();
  app.add_option("--mesh", options.mesh,
                 "this file instead of a shape, as large as the demo's teapot")
      ->check(CLI::ExistingFile);
  app.add_option("--width", options.width, "of the picture [px]")
      ->check(CLI::Range(64, 4096))
      ->capture_default_str();
  app.add_option("--material", options.material,
                 "those whose name or family holds this text; any where it is left out");
  app.add_flag("--first", options.first,
               "begin with the light that the plan's route visits first, as a session does; "
               "otherwise with any");
  app.add_option("--lights", options.lights,
                 "of the plan, any of which may be looked at; as config/demo.toml has it")
      ->check(CLI::Range(1, 400));
  app.add_option("--stride", options.stride, "of the pixels that the plan is made for");
  app.add_option("--shot", options.shot, "begin with this light of the plan");
  app.add_flag("--right-only", options.right_only,
               "no wrong poses: how often is a right one flagged?");
  app.add_flag("--verbose", options.verbose, "a line for every fit");
  app.add_option("--session", options.session,
                 "no cases: judge every captured shot of this session folder");
  CLI11_PARSE(app, argc, argv);
  if (!options.session.empty()) return judge_session(options.session);
  std::vector<std::string> shapes{options.shape};
  if (!options.mesh.empty())
    shapes = {std::filesystem::path(options.mesh).stem().string()};
  else if (options.shape == "all")
    shapes = {"teapot", "torus", "cylinder", "sphere", "plane"};
  Tally all;
  for (const std::string& shape : shapes) {
    const Tally one = run(shape, options);
    all.right += one.right;
    all.false_flags += one.false_flags;
    all.turned += one.turned + one.shifted;
    all.missed_turns += one.missed_turns + one.missed_shifts;
    all.unseen += one.unseen;
    all.untold += one.untold;
    all.seconds += one.seconds;
    all.fits += one.fits;
  }
  fmt::print(
      "looks={} wrong={} missed={} unseen={} right={} false={} untold={} seconds_each={:.2f}\n",
      all.fits, all.turned, all.missed_turns, all.unseen, all.right, all.false_flags, all.untold,
      all.seconds / all.fits);
}
