// Reduction of one shot, frames in memory to coefficients, against the same mathematics in numpy
// with OpenBLAS: one thread each, processor time of the best of three, same frames, same points,
// coefficients compared.

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <ctime>
#include <random>

#include "bench/problem_folder.h"
#include "core/azimuth_model.h"
#include "core/brdf_basis.h"
#include "core/builtin_materials.h"
#include "core/fit.h"
#include "core/merge_hdr.h"
#include "core/pixel_neighbours.h"
#include "core/refine.h"
#include "core/samples.h"
#include "core/shapes.h"
#include "core/surface_points.h"
#include "tests/paths.h"

namespace lightrig {
namespace {

constexpr int width = 2448, height = 2048;  // [px] five megapixels

double cpu_seconds() {
  timespec t{};
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
  return static_cast<double>(t.tv_sec) + 1e-9 * static_cast<double>(t.tv_nsec);
}

SensorModel bench_sensor() {
  SensorModel s;
  s.bits = 12;
  s.gain = 2.6;
  s.black_level = 64;
  s.read_noise = 5;
  s.full_well = 10400;
  s.response = Eigen::Array3d::Constant(2e4);
  s.min_exposure = 1e-5;
  s.max_exposure = 10;
  return s;
}

CameraModel bench_camera() {
  CameraModel camera;
  camera.width = width;
  camera.height = height;
  camera.fx = camera.fy = 9000;
  camera.cx = (width - 1) / 2.0;
  camera.cy = (height - 1) / 2.0;
  camera.camera_from_world =
      look_at({0, 0, 0.5}, Eigen::Vector3d::Zero(), Eigen::Vector3d::UnitY());
  return camera;
}

/// Electrons per second at every site: a base and a lobe lit by the near lamp. Shadows cost
/// extraction the same whatever lies in them.
std::vector<double> electron_rates(const SurfacePoints& points, const LightPosition& light,
                                   double strength, const SensorModel& sensor) {
  std::vector<double> rate(static_cast<std::size_t>(width) * height, 0.0);
  for (Eigen::Index i = 0; i < points.size(); ++i) {
    const Eigen::Vector3d n = points.normal.col(i), v = points.view.col(i);
    const Eigen::Vector3d l = light.direction_from(points.position.col(i));
    const double cos_i = n.dot(l);
    if (cos_i <= 0) continue;
    const double lobe = std::pow(std::max(0.0, n.dot((l + v).normalized())), 80);
    const double f = 0.08 + 0.9 * lobe;
    const double E = strength * light.falloff(points.position.col(i)) * cos_i;
    rate[static_cast<std::size_t>(points.source[static_cast<std::size_t>(i)])] =
        f * E * sensor.response[0];
  }
  return rate;
}

std::vector<Frame> take_bracket(const std::vector<double>& rate, const std::vector<double>& times,
                                const SensorModel& sensor) {
  std::mt19937_64 random(1);
  std::normal_distribution<double> normal;
  std::vector<Frame> frames;
  for (const double t : times) {
    Frame frame{{width, height, {}}, t, frames.size() + 1};
    frame.counts.counts.reserve(rate.size());
    for (const double r : rate) {
      const double electrons =
          std::min(r * t + std::sqrt(r * t) * normal(random), sensor.full_well);
      const double counts =
          sensor.black_level + (electrons + sensor.read_noise * normal(random)) / sensor.gain;
      frame.counts.counts.push_back(static_cast<std::uint16_t>(
          std::clamp(std::round(counts), 0.0, static_cast<double>(sensor.white_level()))));
    }
    frames.push_back(std::move(frame));
  }
  return frames;
}

BrdfBasis bench_basis() {
  std::vector<Material> materials;
  for (const BuiltinMaterial& m : builtin_materials()) {
    materials.push_back({m.name, m.family, m.source, tabulate(m.reflectance, BivariateGrid{}, 4)});
  }
  if (materials.size() > 80) materials.resize(80);
  BasisOptions options;
  options.sigma_folds = 0;
  return *make_basis(materials, options);
}

void write_problem(const ProblemFolder& folder, const std::vector<Frame>& bracket,
                   const SensorModel& sensor, const SurfacePoints& points,
                   const LightPosition& light, double strength, const BrdfBasis& basis,
                   const MergeOptions& merge, const GrazingLimits& limits) {
  std::vector<std::uint16_t> counts;
  std::vector<double> times;
  for (const Frame& f : bracket) {
    counts.insert(counts.end(), f.counts.counts.begin(), f.counts.counts.end());
    times.push_back(f.exposure);
  }
  folder.write("frames", "uint16", fmt::format("{} {}", bracket.size(), width * height),
               counts.data(), counts.size());
  folder.write("exposures", "float64", fmt::format("{}", times.size()), times.data(), times.size());
  const double white = sensor.white_level() * (1 - merge.saturation_margin);
  const double full = std::min(
      white, sensor.black_level + sensor.full_well * (1 - merge.saturation_margin) / sensor.gain);
  const double values[] = {sensor.gain, sensor.black_level,  sensor.read_noise,
                           full,        sensor.dark_current, static_cast<double>(merge.rounds)};
  folder.write("sensor", "float64", "6", values, 6);
  const auto n = static_cast<std::size_t>(points.size());
  const std::string shape = fmt::format("{} 3", n);
  folder.write("position", "float64", shape, points.position.data(), 3 * n);
  folder.write("normal", "float64", shape, points.normal.data(), 3 * n);
  folder.write("view", "float64", shape, points.view.data(), 3 * n);
  folder.write("site", "int32", fmt::format("{}", n), points.source.data(), n);
  folder.write("light", "float64", "3", light.p.data(), 3);
  const double strengths[] = {strength, sensor.response[0]};
  folder.write("strength", "float64", "2", strengths, 2);
  const double bounds[] = {limits.max_theta_d, limits.min_cos_i, limits.min_cos_o};
  folder.write("limits", "float64", "3", bounds, 3);
  folder.write("valid", "uint8", "8100", basis.valid.data(), basis.valid.size());
  const Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor> V = basis.V;
  folder.write("V", "float64", fmt::format("{} {}", V.rows(), V.cols()), V.data(),
               static_cast<std::size_t>(V.size()));
  folder.write("mean", "float64", fmt::format("{}", basis.mean.size()), basis.mean.data(),
               static_cast<std::size_t>(basis.mean.size()));
  folder.write("stddev", "float64", fmt::format("{}", basis.stddev.size()), basis.stddev.data(),
               static_cast<std::size_t>(basis.stddev.size()));
  const double model[] = {basis.model_sigma, basis.mapping.floor};
  folder.write("sigma", "float64", "2", model, 2);
}

struct Times {
  double merge = 0, extract = 0, fit = 0;
  double total() const { return merge + extract + fit; }
};

double number_after(const std::string& text, const std::string& key) {
  const std::size_t at = text.find("\"" + key + "\": ");
  return at == std::string::npos ? std::nan("")
                                 : std::strtod(text.c_str() + at + key.size() + 4, nullptr);
}

std::string run_baseline(const ProblemFolder& folder) {
  const std::string command = fmt::format(
      "OPENBLAS_NUM_THREADS=1 OMP_NUM_THREADS=1 /usr/bin/python3 "
      "{}/bench/baselines/reduce_numpy.py {}",
      lightrig::test::source_dir, folder.path().string());
  std::string text;
  FILE* pipe = ::popen(command.c_str(), "r");
  if (pipe == nullptr) return text;
  for (int c = std::fgetc(pipe); c != EOF; c = std::fgetc(pipe)) text += static_cast<char>(c);
  return ::pclose(pipe) == 0 ? text : std::string();
}

double wall_seconds() {
  timespec t{};
  clock_gettime(CLOCK_MONOTONIC, &t);
  return static_cast<double>(t.tv_sec) + 1e-9 * static_cast<double>(t.tv_nsec);
}

/// What a session reduces at its seventh light: a concave object in colours, materials that depend
/// on φd, mixed pixels left out, footprints kept, the fit of all lights refined.
struct SessionScene {
  SessionScene()
      : sensor(bench_sensor()),
        camera(bench_camera()),
        mesh(make_teapot(0.06, 2)),
        occluder(mesh),
        points(points_of_pixels(mesh, occluder, camera, 1)),
        neighbours(points, width, height),
        spans(spans_of_sites(points.source, width, height)) {
    sensor.filter = ColorFilter::bayer_rggb;
    std::vector<const BuiltinMaterial*> set;
    for (const BuiltinMaterial& m : builtin_materials()) set.push_back(&m);
    if (set.size() > 80) set.resize(80);
    const std::vector<Material> materials = builtin_tables(set, BivariateGrid{}, 16, true);
    BasisOptions options;
    options.threads = 2;
    basis = *make_basis(materials, options);
    azimuths = AzimuthModel(materials, basis);
    extraction.lamp_strength = Eigen::Array3d::Constant(strength);
    extraction.neighbours = &neighbours;
    extraction.footprints = 24;
    extraction.threads = 2;
  }

  BrdfObservations observed(const RadianceImage& image, const LightPosition& light) const {
    return extract(image, nullptr, points, camera, light, basis.grid, basis.valid, occluder,
                   extraction);
  }

  /// Rows of a light that was reduced before, from its radiance with one percent of noise.
  BrdfObservations earlier(const LightPosition& light) const {
    const std::vector<double> rate = electron_rates(points, light, strength, sensor);
    RadianceImage image{width, height, sensor.filter, {}, {}, {}};
    for (const double r : rate) {
      const double L = r / sensor.response[0];
      image.L.push_back(static_cast<float>(L));
      image.variance.push_back(static_cast<float>(1e-4 * L * L + 1e-12));
    }
    image.site.assign(rate.size(), RadianceImage::Site::measured);
    return observed(image, light);
  }

  static constexpr double strength = 8;  // [W/sr]
  SensorModel sensor;
  CameraModel camera;
  Mesh mesh;
  Occluder occluder;
  SurfacePoints points;
  PixelNeighbours neighbours;
  RowSpans spans;
  BrdfBasis basis;
  AzimuthModel azimuths;
  ExtractOptions extraction;
};

struct SessionTimes {
  double wall = 1e9, processor = 1e9;
};

/// Seconds of the seventh light on two threads, best of three.
SessionTimes seventh_light_of_a_session(const std::vector<double>& times) {
  const SessionScene scene;
  std::vector<BrdfObservations> lights;
  for (int i = 0; i < 6; ++i) {
    const double turn = i * 1.0;
    lights.push_back(
        scene.earlier({false, {0.4 * std::cos(turn), 0.4 * std::sin(turn), 0.15 + 0.05 * i}}));
  }
  const LightPosition last{false, {0.35, 0.25, 0.4}};
  const std::vector<Frame> bracket =
      take_bracket(electron_rates(scene.points, last, SessionScene::strength, scene.sensor), times,
                   scene.sensor);
  MergeOptions merge;
  merge.threads = 2;
  merge.spans = &scene.spans;
  SessionTimes best;
  lights.emplace_back();
  for (int i = 0; i < 3; ++i) {
    const double wall = wall_seconds(), processor = cpu_seconds();
    const Result<RadianceImage> image = merge_hdr(bracket, {}, scene.sensor, merge);
    lights.back() = scene.observed(*image, last);
    const AdaptiveFit fitted = fit_refined(scene.basis, scene.azimuths, lights, 3, {});
    if (!fitted.coefficients.c.allFinite()) continue;
    best.wall = std::min(best.wall, wall_seconds() - wall);
    best.processor = std::min(best.processor, cpu_seconds() - processor);
  }
  fmt::print("a session's seventh light: {} surface points, {} rows of it, {} components\n",
             scene.points.size(), lights.back().rows.size(), scene.basis.components());
  return best;
}

int compare() {
  const SensorModel sensor = bench_sensor();
  const CameraModel camera = bench_camera();
  const Mesh mesh = make_sphere(0.05, 2);
  const Occluder occluder(mesh);
  const SurfacePoints points = points_of_pixels(mesh, occluder, camera, 1);
  const LightPosition light{false, {0.35, 0.25, 0.4}};
  const double strength = 8;  // [W/sr]
  const std::vector<Frame> bracket = take_bracket(electron_rates(points, light, strength, sensor),
                                                  {0.0005, 0.002, 0.008, 0.032, 0.128}, sensor);
  const BrdfBasis basis = bench_basis();
  const MergeOptions merge;
  ExtractOptions extract_options;
  extract_options.lamp_strength = Eigen::Array3d::Constant(strength);
  extract_options.drop_mixed = false;
  Times best{1e9, 0, 0};
  Coefficients c;
  std::size_t rows = 0;
  for (int i = 0; i < 3; ++i) {
    Times t;
    const double t0 = cpu_seconds();
    // Pixels that see nothing of the object are left out, here and in numpy.
    const RowSpans spans = spans_of_sites(points.source, width, height);
    MergeOptions seen = merge;
    seen.spans = &spans;
    const Result<RadianceImage> image = merge_hdr(bracket, {}, sensor, seen);
    const double t1 = cpu_seconds();
    const std::vector<BrdfObservations> lights = {extract(*image, nullptr, points, camera, light,
                                                          basis.grid, basis.valid, occluder,
                                                          extract_options)};
    const double t2 = cpu_seconds();
    c = fit(basis, lights, 1, {});
    const double t3 = cpu_seconds();
    t = {t1 - t0, t2 - t1, t3 - t2};
    rows = lights[0].rows.size();
    if (t.total() < best.total()) best = t;
  }
  const ProblemFolder folder;
  write_problem(folder, bracket, sensor, points, light, strength, basis, merge,
                extract_options.limits);
  const std::string json = run_baseline(folder);
  if (json.empty()) {
    fmt::print(stderr,
               "compare_reduce: the numpy baseline did not run; install python3-numpy and "
               "libopenblas0-pthread\n");
    return 1;
  }
  const std::vector<double> other =
      folder.read<double>("c_numpy", static_cast<std::size_t>(basis.components()));
  double apart = 0;
  for (Eigen::Index i = 0; i < basis.components(); ++i) {
    apart =
        std::max(apart, std::abs(other[static_cast<std::size_t>(i)] - c.c(i, 0)) / basis.stddev[i]);
  }
  const Times numpy{number_after(json, "merge"), number_after(json, "extract"),
                    number_after(json, "fit")};
  fmt::print(
      "one shot, {} x {} px, {} exposures, {} surface points, {} rows, {} components\n"
      "processor seconds, one thread each, best of 3, frames in memory to coefficients\n"
      "{:<10}{:>10}{:>10}{:>9}\n",
      width, height, bracket.size(), points.size(), rows, basis.components(), "stage", "lightrig",
      "numpy", "ratio");
  const auto line = [](const char* name, double ours, double theirs) {
    fmt::print("{:<10}{:>10.3f}{:>10.3f}{:>9.1f}\n", name, ours, theirs, theirs / ours);
  };
  line("merge", best.merge, numpy.merge);
  line("extract", best.extract, numpy.extract);
  line("fit", best.fit, numpy.fit);
  line("total", best.total(), numpy.total());
  fmt::print("largest difference of a coefficient, in prior deviations: {:.2e}\nbaseline: {}\n",
             apart, json);
  const SessionTimes shot = seventh_light_of_a_session({0.0005, 0.002, 0.008, 0.032, 0.128});
  fmt::print(
      "speedup_numpy={:.2f} seconds={:.3f} same_coefficients={} session_shot_5mp_s={:.3f} "
      "session_shot_5mp_cpu_s={:.3f}\n",
      numpy.total() / best.total(), best.total(), apart < 1e-3 ? "yes" : "no", shot.wall,
      shot.processor);
  return apart < 1e-3 ? 0 : 1;
}

}  // namespace
}  // namespace lightrig

int main() { return lightrig::compare(); }
